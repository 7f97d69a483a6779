from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from flexarm_daq.rigs.rig_protocol import DriveNotStoppedError, RigError
from support.exhaustive import first_of
from support.nidaq_board import Board
from support.nidaq_session import DIRECTION, MAGNITUDE, make, session
from support.nidaqmx_double import NidaqmxDouble
from support.nidaqmx_values import (
    CALL_SITES,
    OVERRUN,
    REMOVED,
    RESERVED,
    TIMEOUT,
    UNKNOWN_DEVICE,
    Fault,
)
from support.project import PROJECT

CODES = (OVERRUN, TIMEOUT, REMOVED, RESERVED, UNKNOWN_DEVICE, -50405, -123456)


def assert_direction_changes_at_zero(board: Board) -> None:
    held = {MAGNITUDE: 0.0, DIRECTION: 0.0}
    for write in board.writes:
        if write.channel == DIRECTION and write.volts != held[DIRECTION]:
            assert held[MAGNITUDE] == 0.0, write
        held[write.channel] = write.volts


def test_call_sites___are_those_of_a_session() -> None:
    board, double, rig = make()
    session(rig)
    assert set(double.calls) == set(CALL_SITES)
    assert board.outputs_v[MAGNITUDE] == 0.0
    assert all(task.closed for task in double.tasks)


def test_write___direction_flips___magnitude_is_zero_before() -> None:
    board, _, rig = make()
    rig.open()
    board.writes.clear()
    for command_v in (2.0, 3.0, -4.0, 0.0, -1.0, 12.0):
        rig.write([command_v])
    assert [(write.channel[-3:], write.volts) for write in board.writes] == [
        ("ao0", 0.0),
        ("ao1", 5.0),
        ("ao0", 2.0),
        ("ao0", 3.0),
        ("ao0", 0.0),
        ("ao1", 0.0),
        ("ao0", 4.0),
        ("ao0", 0.0),
        ("ao0", 1.0),
        ("ao0", 0.0),
        ("ao1", 5.0),
        ("ao0", 10.0),
    ]
    rig.close()


@settings(max_examples=50)
@given(
    commands_v=st.lists(st.floats(-20.0, 20.0), max_size=20),
    high_is_positive=st.booleans(),
    left_v=st.sampled_from([0.0, 7.0]),
)
@pytest.mark.slow
def test_write___any_commands___drive_has_them_and_turns_at_zero(
    commands_v: list[float],
    high_is_positive: bool,  # noqa: FBT001 - drawn by hypothesis
    left_v: float,
) -> None:
    board = Board(low_is_positive=not high_is_positive)
    board.outputs_v[MAGNITUDE] = left_v
    rig = NidaqRig(NidaqSettings(high_is_positive=high_is_positive), nidaqmx=NidaqmxDouble(board))
    rig.open()
    assert board.command_v == 0.0
    for command_v in commands_v:
        rig.write([command_v])
        assert board.command_v == np.clip(command_v, -10.0, 10.0)
    rig.close()
    assert board.writes[0].channel == MAGNITUDE
    assert board.writes[0].volts == 0.0
    assert_direction_changes_at_zero(board)
    assert board.outputs_v[MAGNITUDE] == 0.0


def test_read___samples_by_the_boards_clock___time_counts_its_periods() -> None:
    board, _, rig = make(rate_hz=300.0)
    rig.open()
    times_s = [rig.read().time_s for _ in range(5)]
    rate_hz = 20e6 / 66667
    np.testing.assert_allclose(times_s, np.arange(5) / rate_hz, rtol=1e-12)
    assert board.clock() == pytest.approx(4 / rate_hz, abs=1e-6)
    rig.close()


def test_read___reader_was_late___takes_the_newest_and_shows_the_gap() -> None:
    board, _, rig = make(rate_hz=500.0)
    rig.open()
    first = rig.read()
    board.sensors = lambda volts: volts + 4.0
    board.clock.sleep(10.5 / 500.0)
    late = rig.read()
    assert round((late.time_s - first.time_s) * 500.0) == 10
    assert late.outputs[0] == pytest.approx(4.0, abs=0.1)
    # Nothing is left over from the gap.
    assert round((rig.read().time_s - late.time_s) * 500.0) == 1
    rig.close()


def test_read___keeps_its_sample_when_the_next_comes() -> None:
    board, _, rig = make()
    rig.open()
    first = rig.read()
    kept = first.outputs.copy()
    board.sensors = lambda volts: volts + 4.0
    rig.read()
    np.testing.assert_array_equal(first.outputs, kept)
    rig.close()


def test_read___stalled_for_longer_than_the_buffer___is_an_error_and_zero() -> None:
    board, _, rig = make()
    rig.open()
    rig.write([3.0])
    board.clock.sleep(11.0)
    with pytest.raises(RigError, match=r"Dev1/ai0.*-200279.*overwritten"):
        rig.read()
    assert board.outputs_v[MAGNITUDE] == 0.0
    rig.close()


def test_read___clock_of_the_board_stops___times_out_within_three_periods() -> None:
    board, double, rig = make(rate_hz=100.0)
    rig.open()
    rig.read()
    rig.write([3.0])
    (task,) = [task for task in double.tasks if task.kind == "ai"]
    task.timing.rate_hz = 1e-3
    started_s = board.clock()
    with pytest.raises(RigError, match="-200284"):
        rig.read()
    assert board.clock() - started_s <= 3.1 / 100.0
    assert board.outputs_v[MAGNITUDE] == 0.0
    rig.close()


@pytest.mark.parametrize("times", [1, np.inf])
@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("code", first_of(CODES, 2))
@pytest.mark.parametrize("site", CALL_SITES)
def test_any_error_at_any_call___names_the_channel_and_leaves_zero(
    site: str,
    code: int,
    late: bool,  # noqa: FBT001 - a parameter of the test
    times: float,
) -> None:
    _, healthy, rig = make()
    session(rig)
    at = healthy.calls[site] if late else 1

    board, double, rig = make()
    board.outputs_v[MAGNITUDE] = 6.0
    double.faults = [Fault(site, code, at, times)]
    try:
        session(rig)
    except DriveNotStoppedError as error:
        pytest.fail(f"the board could still be reset: {error}")
    except RigError as error:
        text = str(error)
        assert "Dev1/" in text
        assert f"NI-DAQmx error {code}" in text
        assert "\n" not in text
        assert text.rpartition(": ")[2]
    else:
        # Zero was written before, and the task is given up in any case.
        assert site.endswith(".close") or (site == "ao.write_one_sample" and late)
    unreachable = not late and times > 1 and site in {"Task", "ao.add_ao_voltage_chan", "ao.start"}
    if not unreachable:
        assert board.outputs_v[MAGNITUDE] == 0.0
    assert_direction_changes_at_zero(board)
    assert all(task.closed for task in double.tasks if task.kind)

    double.faults.clear()
    session(rig)
    assert board.outputs_v[MAGNITUDE] == 0.0


@pytest.mark.parametrize("calls", range(2, 60, 4))
def test_board_is_pulled_out___says_that_the_drive_may_be_driven(calls: int) -> None:
    board, double, rig = make()
    call = double.call

    def call_and_pull(site: str) -> None:
        double.removed = double.removed or sum(double.calls.values()) >= calls
        call(site)

    double.call = call_and_pull  # type: ignore[method-assign]
    with pytest.raises(RigError, match="-201003") as raised:
        session(rig)
    if any(write.volts for write in board.writes):
        assert isinstance(raised.value, DriveNotStoppedError)
        assert "press the emergency stop" in str(raised.value)


def test_write___no_finite_command___is_an_error_and_zero() -> None:
    board, _, rig = make()
    for command_v in (float("nan"), float("inf"), -float("inf")):
        rig.open()
        rig.write([3.0])
        with pytest.raises(RigError, match="command_v must be finite"):
            rig.write([command_v])
        assert board.outputs_v[MAGNITUDE] == 0.0
        rig.close()


def test_safe_stop_and_close___in_any_state___do_no_harm() -> None:
    board, double, rig = make()
    rig.safe_stop()
    rig.close()
    assert not double.calls
    rig.open()
    rig.open()
    rig.write([3.0])
    rig.safe_stop()
    rig.safe_stop()
    assert board.outputs_v[MAGNITUDE] == 0.0
    rig.close()
    rig.close()
    rig.safe_stop()
    for use in (rig.read, lambda: rig.write([1.0])):
        with pytest.raises(RigError, match="not open"):
            use()


_LEAVES_WITHOUT_CLOSING = """
import atexit, sys
from support.nidaq_board import Board
from support.nidaqmx_double import NidaqmxDouble
from flexarm_daq.rigs.nidaq.board import NidaqRig

board = Board()
atexit.register(lambda: print("ao0", board.outputs_v["Dev1/ao0"]))
rig = NidaqRig(nidaqmx=NidaqmxDouble(board))
rig.open()
rig.write([3.0])
print("driven", board.command_v)
{leave}
"""


@pytest.mark.parametrize("leave", first_of(["raise KeyError('a bug')", "sys.exit(3)", "pass"]))
@pytest.mark.slow
def test_interpreter_ends_with_the_rig_open___drive_is_at_zero(leave: str) -> None:
    ended = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", _LEAVES_WITHOUT_CLOSING.format(leave=leave)],
        capture_output=True,
        text=True,
        check=False,
        env={"PYTHONPATH": ":".join(["test", *filter(None, sys.path)])},
        cwd=PROJECT,
    )
    assert ended.stdout.splitlines() == ["driven 3.0", "ao0 0.0"], ended.stderr
