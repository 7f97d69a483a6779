from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from bench.loop import loop, peers
from bench.loop.loop import Row

if TYPE_CHECKING:
    from pathlib import Path


def row(reply_ms: float, *, samples: int = 0, realtime: bool = True) -> Row:
    times = dict.fromkeys(("p50", "p99", "p999", "max"), reply_ms)
    return Row(300.0, 300.0, times, times, times, samples, 0, 0, 0, 0, 0, {}, realtime, load=False)


def test_rounds___joined___have_medians_of_times_and_sums_of_counts() -> None:
    rounds = [row(1.0, samples=10), row(9.0, samples=20, realtime=False), row(2.0, samples=30)]
    found = loop.joined(rounds)
    assert found.reply_ms == {"p50": 2.0, "p99": 2.0, "p999": 2.0, "max": 9.0}
    assert found.asked_hz == pytest.approx(300.0)
    assert found.samples == 60
    assert not found.realtime


def test_row___beside_a_peer___has_the_ratio_to_it() -> None:
    peer = {"p50": 0.5, "p99": 1.0, "p999": 2.0, "max": 4.0, "samples": 6.0}
    found = loop._beside_peers(row(2.0), {peers.RCL: peer})
    assert found.ratio_to_peer == {"p50": 4.0, "p99": 2.0, "p999": 1.0, "max": 0.5}
    assert found.peer_reply_ms == {name: peer[name] for name in found.ratio_to_peer}
    assert found.udp_reply_ms == {}


def test_peers___without_a_compiler___are_missing_in_a_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert peers.built(tmp_path) == ({}, ["no peer in C: gcc is not installed"])


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_datagrams___without_ros___are_answered_and_the_peer_on_rcl_is_missing_in_a_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", "")
    programs, (line,) = peers.built(tmp_path)
    assert line.startswith("no peer rcl: ")
    assert "flexarm_msgs" in line
    figures = peers.measured(programs[peers.UDP], 200.0, 0.5)
    assert figures["samples"] == 100
    assert 0.0 < figures["p50"] <= figures["p99"] <= figures["p999"] <= figures["max"]
