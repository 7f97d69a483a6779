"""Trouble of a run as the DAQ node reports it."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from flexarm_bringup.graph.operator import trouble_in

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
STUCK = "the drive is held at zero: position_v is stuck at 0.000 V"


@pytest.mark.parametrize(
    ("level", "message", "held_s", "trouble"),
    [
        (OK, "active", "", ""),
        (WARN, "active: no command in time: the drive is at zero", "", ""),
        (ERROR, f"active: {STUCK}", "0.150", f"{STUCK}, after 0.150 s of the run"),
        (ERROR, f"not active: {STUCK}", "0.150", f"{STUCK}, after 0.150 s of the run"),
        (ERROR, "not active: the loop has ended: no close", "", "the loop has ended: no close"),
    ],
)
def test_report___of_a_held_drive_or_an_ended_loop___is_trouble_with_its_time(
    level: bytes, message: str, held_s: str, trouble: str
) -> None:
    values = [KeyValue(key="samples", value="45"), KeyValue(key="held after s", value=held_s)]
    status = DiagnosticStatus(level=level, message=message, values=values)
    assert trouble_in(status) == trouble
