"""Experiments of a page: who commands, and what a stop leaves behind."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_core.errors import FlexarmError
from flexarm_core.rig_description import load_rig
from flexarm_live.graph.chain import Chain
from flexarm_live.graph.store import Store
from flexarm_live.serving.laboratory import Answer
from support.foreign_rigs import ONE_JOINT

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from flexarm_core.rig_description import RigDescription

HELD = "the drive is held at zero: emergency stop"


class NotedParameters:
    """Parameters of a node that notes what is set."""

    def __init__(self, node: str, values: Mapping[str, Any], done: list[str]) -> None:
        self.values = dict(values)
        self._node, self._done = node, done

    async def load(self) -> None:
        """Do nothing: the values are there."""

    async def set(self, wanted: Mapping[str, Any]) -> None:
        """Take values."""
        self.values |= wanted
        self._done.append(f"set {self._node}")


class NotedLoop:
    """Nodes of a loop that note what is done with them; every run has its samples at once."""

    def __init__(self) -> None:
        self.done: list[str] = []
        rig = {"rate_hz": 250.0, "payload_kg": 0.1}
        self.parameters = {
            "daq": NotedParameters("daq", rig, self.done),
            "controller": NotedParameters("controller", {"law": "pdpc"}, self.done),
        }
        self.experiment = NotedParameters("experiment", {}, self.done)
        self.due: dict[str, Any] = {}
        self.runs: list[tuple[dict[str, Any], int]] = []

    async def activate(self, name: str) -> None:
        self.done.append(f"activate {name}")

    async def deactivate(self, name: str) -> None:
        self.done.append(f"deactivate {name}")

    async def release(self, name: str) -> None:
        self.done.append(f"release {name}")

    async def is_active(self, _name: str) -> bool:
        return False

    async def restart_sampling(self, changes: Mapping[str, Any], *, samples: int = 0) -> None:
        self.done.append("sample")
        self.runs.append((dict(changes), samples))

    def postpone(self, changes: Mapping[str, Any]) -> None:
        self.due |= changes


class Bench:
    """Chain on such a loop; `held` is what the drive is held for, from the first sample on."""

    def __init__(self, folder: Path, held: str = "", rig: RigDescription | None = None) -> None:
        self.loop = NotedLoop()
        self._held = held
        rig = rig or load_rig("thesis")
        self.chain = Chain(Store(folder), self.loop, self._held_now, rig)  # type: ignore[arg-type]

    def _held_now(self) -> str:
        return self._held if self.loop.runs else ""

    async def record(self, on: bool) -> Answer:  # noqa: FBT001 - a field of a request
        self.loop.done.append("record" if on else "end the record")
        return Answer(data={"bag": "live_1"})

    def run(self, name: str) -> Mapping[str, Any]:
        work = self.chain.experiment(name, self.record, lambda: 10_000)
        return asyncio.run(asyncio.wait_for(_done(work), 60.0))


async def _done(work: Any) -> Mapping[str, Any]:  # noqa: ANN401 - of jobs
    found: Mapping[str, Any] = await work(lambda _stage, _fraction: None)
    return found


def test_experiment_in_open_loop___has_the_command_alone___and_gives_it_back(
    tmp_path: Path,
) -> None:
    bench = Bench(tmp_path)
    assert bench.run("O_dat4")["bag"] == "live_1"
    assert bench.loop.done == [
        "deactivate daq",
        "set experiment",
        "release controller",
        "activate experiment",
        "record",
        "sample",
        "end the record",
        "deactivate daq",
        "release experiment",
        "set controller",
        "activate controller",
        "sample",
    ]
    assert bench.loop.experiment.values == {"waveform": "square", "magnitude_v": 2.0, "seed": 1}
    there, back = bench.loop.runs
    assert there == ({"rate_hz": 500.0, "payload_kg": 0.0}, 5000)
    assert back == ({"rate_hz": 250.0, "payload_kg": 0.1}, 0)


def test_experiment_of_another_arm___has_its_length_at_the_rate_of_the_arm(tmp_path: Path) -> None:
    bench = Bench(tmp_path, rig=ONE_JOINT)
    bench.run("O_dat4")
    there, back = bench.loop.runs
    assert there == ({}, 2000)
    assert back == ({}, 0)


def test_experiment_in_closed_loop___of_another_arm___is_left_to_the_verb(tmp_path: Path) -> None:
    bench = Bench(tmp_path, rig=ONE_JOINT)
    with pytest.raises(FlexarmError, match="C_dat3 needs gains of one-joint, which `flexarm exp"):
        bench.run("C_dat3")
    assert bench.loop.done == []


@pytest.mark.parametrize("name", ["O_dat4", "C_dat3"])
def test_experiment___stopped___keeps_its_record_and_the_drive_held(
    name: str, tmp_path: Path
) -> None:
    bench = Bench(tmp_path, HELD)
    controller = bench.loop.parameters["controller"]
    controller.values |= {
        "reference": "topic",
        **{f"pd.{gain}": 0.5 for gain in ("kp", "kd", "compensation_v")},
        **{f"varying_square.{each}": 1.0 for each in ("amplitude_v", "shortest_s", "longest_s")},
        "varying_square.seed": 3,
    }
    before = dict(controller.values)
    with pytest.raises(FlexarmError, match=f"{HELD}; the record is kept"):
        bench.run(name)
    after_the_stop = bench.loop.done[bench.loop.done.index("sample") + 1 :]
    assert after_the_stop[0] == "end the record"
    assert not {"sample", "deactivate daq"} & set(after_the_stop)
    assert after_the_stop[-1] == "activate controller"
    assert controller.values == before
    assert bench.loop.due == {"samples": 0, "rate_hz": 250.0, "payload_kg": 0.1}


def test_experiment___on_a_drive_that_is_held___is_refused(tmp_path: Path) -> None:
    bench = Bench(tmp_path, HELD)
    bench.loop.runs.append(({}, 0))
    with pytest.raises(FlexarmError, match="release it before an experiment"):
        bench.run("O_dat4")
    assert bench.loop.done == []
