"""Runs whose drive is held at zero, and what their verb tells."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_ident.models.model_parameters import write_parameter_file
from support.recorded_samples import States
from support.system_graph import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system

COMMAND = [str(ROOT / "flexarm"), "experiment", "B_dat1"]


def failed_run(graph: Graph, folder: Path, pace: str, daq: dict[str, Any]) -> str:
    """Run an experiment that fails, and return its last line."""
    write_parameter_file(folder / "rig.yaml", daq, node="/flexarm/daq")
    files = ["--params-file", str(folder / "rig.yaml"), "-o", str(folder / "out")]
    process = graph.run([*COMMAND, pace, *files])
    assert process.exit_code() == 1, process.printed
    assert graph.survivors() == []
    return process.printed.splitlines()[-1]


STUCK, NO_NUMBER = ("stuck", "is stuck at"), ("not_a_number", "is not a number")


@pytest.mark.parametrize(
    ("fault", "reason", "pace"),
    [
        pytest.param(*STUCK, "--real-time", marks=pytest.mark.exhaustive),
        (*NO_NUMBER, "--fast"),
        pytest.param(*STUCK, "--fast", marks=pytest.mark.exhaustive),
        pytest.param(*NO_NUMBER, "--real-time", marks=pytest.mark.exhaustive),
    ],
)
def test_sensor_fault_in_an_experiment___ends_it_with_the_reason_and_keeps_the_record(
    graph: Graph, tmp_path: Path, fault: str, reason: str, pace: str
) -> None:
    daq = {"fault": fault, "fault_after_samples": 30, "fault_channel": "middle_strain_v"}

    last = failed_run(graph, tmp_path, pace, daq)

    reported = re.fullmatch(
        # A busy machine may have held the loop up before, which is told first.
        rf"flexarm: daq: (?:.*: )?the drive is held at zero: middle_strain_v "
        rf"{reason}.*, after (\S+) s of the run; fix the cause and run again \(docs/safety.md\)",
        last,
    )
    assert reported is not None, last
    assert 30 / 300 <= float(reported[1]) < 40.0
    kept = States(tmp_path / "out" / "B_dat1.partial")
    held_at = round(float(reported[1]) * 300) + 1
    assert len(kept.sequence) < 12000
    assert not kept.command_v[kept.sequence > held_at].any()
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"B_dat1.partial", "nodes.log"}


@pytest.mark.exhaustive
def test_first_reading_that_is_short___ends_the_run_with_the_reason(
    graph: Graph, tmp_path: Path
) -> None:
    last = failed_run(graph, tmp_path, "--real-time", {"fault": "short_read"})
    assert last.startswith("flexarm: daq: the loop has ended: short reading: 3 of 4 channels")
