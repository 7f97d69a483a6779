from __future__ import annotations

import inspect
import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_core.errors import SettingError
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.driver import load_nidaqmx
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from flexarm_daq.rigs.rig_protocol import DriveNotStoppedError, RigError
from support import nidaqmx_double as double_module
from support.nidaq_board import Board
from support.nidaqmx_double import (
    CALL_SITES,
    NOT_SUPPORTED,
    OVERRUN,
    REMOVED,
    RESERVED,
    TIMEOUT,
    UNKNOWN_CHANNEL,
    UNKNOWN_DEVICE,
    Fault,
    NidaqmxDouble,
)
from support.project import PROJECT

CODES = (OVERRUN, TIMEOUT, REMOVED, RESERVED, UNKNOWN_DEVICE, -50405, -123456)
MAGNITUDE, DIRECTION = "Dev1/ao0", "Dev1/ao1"


def make(**options: Any) -> tuple[Board, NidaqmxDouble, NidaqRig]:  # noqa: ANN401
    board = Board()
    double = NidaqmxDouble(board)
    return board, double, NidaqRig(NidaqSettings(**options), nidaqmx=double)


def session(rig: NidaqRig) -> None:
    """Drive to and fro, as the sampling loop does."""
    try:
        rig.open()
        for k in range(12):
            rig.read()
            rig.write(-3.0 if k % 4 < 2 else 5.0)
    finally:
        rig.safe_stop()
        rig.close()


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
        rig.write(command_v)
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
        rig.write(command_v)
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
    assert late.volts[0] == pytest.approx(4.0, abs=0.1)
    # Nothing is left over from the gap.
    assert round((rig.read().time_s - late.time_s) * 500.0) == 1
    rig.close()


def test_read___keeps_its_sample_when_the_next_comes() -> None:
    board, _, rig = make()
    rig.open()
    first = rig.read()
    kept = first.volts.copy()
    board.sensors = lambda volts: volts + 4.0
    rig.read()
    np.testing.assert_array_equal(first.volts, kept)
    rig.close()


def test_read___stalled_for_longer_than_the_buffer___is_an_error_and_zero() -> None:
    board, _, rig = make()
    rig.open()
    rig.write(3.0)
    board.clock.sleep(11.0)
    with pytest.raises(RigError, match=r"Dev1/ai0.*-200279.*overwritten"):
        rig.read()
    assert board.outputs_v[MAGNITUDE] == 0.0
    rig.close()


def test_read___clock_of_the_board_stops___times_out_within_three_periods() -> None:
    board, double, rig = make(rate_hz=100.0)
    rig.open()
    rig.read()
    rig.write(3.0)
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
@pytest.mark.parametrize("code", CODES)
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
        rig.write(3.0)
        with pytest.raises(RigError, match="command_v must be finite"):
            rig.write(command_v)
        assert board.outputs_v[MAGNITUDE] == 0.0
        rig.close()


def test_safe_stop_and_close___in_any_state___do_no_harm() -> None:
    board, double, rig = make()
    rig.safe_stop()
    rig.close()
    assert not double.calls
    rig.open()
    rig.open()
    rig.write(3.0)
    rig.safe_stop()
    rig.safe_stop()
    assert board.outputs_v[MAGNITUDE] == 0.0
    rig.close()
    rig.close()
    rig.safe_stop()
    for use in (rig.read, lambda: rig.write(1.0)):
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
rig.write(3.0)
print("driven", board.command_v)
{leave}
"""


@pytest.mark.parametrize("leave", ["sys.exit(3)", "raise KeyError('a bug')", "pass"])
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


def test_two_rigs_on_one_board___second_is_refused_and_first_goes_on() -> None:
    board, double, first = make()
    first.open()
    first.write(2.0)
    second = NidaqRig(nidaqmx=double)
    with pytest.raises(RigError, match=r"Dev1/ao0 \(magnitude\).*another program holds the board"):
        second.open()
    assert board.command_v == 2.0
    assert board.resets == 0
    first.close()
    second.open()
    second.close()


@pytest.mark.parametrize(
    ("options", "change", "message"),
    [
        ({"device": "Dev7"}, {}, rf"Dev7/ao0 \(magnitude\).*{UNKNOWN_DEVICE}.*nidaq.device"),
        (
            {"sensors": ("ai0", "ai1", "ai2", "ai99")},
            {},
            rf"Dev1/ai99 \(speed_v\).*{UNKNOWN_CHANNEL}.*no such channel",
        ),
        ({"direction": "ao7"}, {}, rf"Dev1/ao7 \(direction\).*{UNKNOWN_CHANNEL}"),
        (
            {"terminals": "nrse"},
            {"terminals": ["RSE", "DIFF"]},
            rf"Dev1/ai0 \(position_v\).*{NOT_SUPPORTED}",
        ),
        ({}, {"input_range_v": 5.0}, rf"Dev1/ai0.*{NOT_SUPPORTED}.*ranges"),
        ({}, {"output_range_v": (0.0, 5.0)}, rf"Dev1/ao0 \(magnitude\).*{NOT_SUPPORTED}"),
        ({"rate_hz": 2000.0}, {"fastest_hz": 4000.0}, r"sensors Dev1/ai0.*-200081.*lower rate_hz"),
        ({"rate_hz": 15e6}, {"fastest_hz": 1e9}, "the board's clock makes 2e.07 Hz of rate_hz"),
    ],
)
def test_open___board_cannot___says_what_to_do(
    options: dict[str, Any], change: dict[str, Any], message: str
) -> None:
    board, double, rig = make(**options)
    for name, value in change.items():
        setattr(board, name, value)
    with pytest.raises(RigError, match=message):
        rig.open()
    assert all(task.closed for task in double.tasks)
    assert not any(write.volts for write in board.writes)


def test_open___no_driver___names_the_command_that_installs_it() -> None:
    _, double, rig = make()
    double.has_driver = False
    command = re.escape(f"driver is not installed: {sys.executable} -m nidaqmx installdriver")
    with pytest.raises(RigError, match=command):
        rig.open()


def test_open___other_platform___says_so() -> None:
    _, double, rig = make()

    def call(site: str) -> None:
        raise double_module.DaqNotSupportedError(site)

    double.call = call  # type: ignore[method-assign]
    with pytest.raises(RigError, match="no NI-DAQmx driver for this platform"):
        rig.open()


def test_load_nidaqmx___package_missing___names_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    command = re.escape(f'{sys.executable} -m pip install "nidaqmx>=1.0,<2"')
    with pytest.raises(RigError, match=command):
        NidaqRig().open()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensors": ("ai0", "ai1")}, "sensors must name 4 inputs.*got ai0, ai1"),
        ({"sensors": ("ai0", "ai1", "ai2", "ai1")}, "ai1 is used for two channels"),
        ({"magnitude": "ao1"}, "ao1 is used for two channels"),
        ({"device": ""}, "'' names no board"),
        ({"direction": "Dev1/ao1"}, "'Dev1/ao1' names no board or channel"),
        ({"terminals": "single"}, "terminals must be one of"),
        ({"rate_hz": 0.0}, "rate_hz must be positive"),
        ({"rate_hz": float("nan")}, "rate_hz must be positive"),
    ],
)
def test_settings___unusable___are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        NidaqSettings(**options)


@pytest.mark.skipif(find_spec("nidaqmx") is None, reason="the package nidaqmx is not installed")
def test_double___has_the_signatures_of_the_package() -> None:
    real = load_nidaqmx()
    codes = import_module("nidaqmx.error_codes").DAQmxErrors
    channels = import_module("nidaqmx.task.collections")
    # What a task is made of exists only with the driver below it.
    in_stream = import_module("nidaqmx.task._in_stream").InStream
    timing = import_module("nidaqmx.task._timing").Timing

    ours, task = double_module, double_module.Task
    pairs: list[tuple[Any, Any]] = [
        (task.__init__, real.Task.__init__),
        (task.start, real.Task.start),
        (task.close, real.Task.close),
        (task._add_ai_voltage_chan, channels.AIChannelCollection.add_ai_voltage_chan),
        (task._add_ao_voltage_chan, channels.AOChannelCollection.add_ao_voltage_chan),
        (ours._Timing.cfg_samp_clk_timing, timing.cfg_samp_clk_timing),
        (
            ours.AnalogMultiChannelReader.__init__,
            real.stream_readers.AnalogMultiChannelReader.__init__,
        ),
        (
            ours.AnalogMultiChannelReader.read_one_sample,
            real.stream_readers.AnalogMultiChannelReader.read_one_sample,
        ),
        (
            ours.AnalogSingleChannelWriter.__init__,
            real.stream_writers.AnalogSingleChannelWriter.__init__,
        ),
        (
            ours.AnalogSingleChannelWriter.write_one_sample,
            real.stream_writers.AnalogSingleChannelWriter.write_one_sample,
        ),
        (ours._Device.reset_device, real.system.Device.reset_device),
    ]
    for mine, theirs in pairs:
        # The option of a remote driver is left out.
        wanted = [name for name in inspect.signature(theirs).parameters if name != "grpc_options"]
        own = [
            name for name in inspect.signature(mine).parameters if name not in {"self", "double"}
        ]
        assert own == [name for name in wanted if name != "self"], theirs
    for name in (
        *("product_type", "is_simulated", "ai_physical_chans", "ao_physical_chans"),
        *("ai_voltage_rngs", "ao_voltage_rngs", "ai_max_multi_chan_rate"),
    ):
        assert isinstance(inspect.getattr_static(real.system.Device, name), property)
    assert isinstance(inspect.getattr_static(in_stream, "avail_samp_per_chan"), property)
    assert isinstance(inspect.getattr_static(timing, "samp_clk_rate"), property)
    assert hasattr(real.stream_readers.AnalogMultiChannelReader, "verify_array_shape")
    for ours_enum, theirs_enum in (
        (ours.TerminalConfiguration, real.constants.TerminalConfiguration),
        (ours.AcquisitionType, real.constants.AcquisitionType),
    ):
        for member in ours_enum:
            assert theirs_enum[member.name].value == member.value
    for name in ("DaqError", "DaqNotFoundError", "DaqNotSupportedError"):
        assert issubclass(getattr(real.errors, name), real.errors.Error)
    assert real.errors.DaqError("text", OVERRUN).error_code == OVERRUN
    assert {code: codes(code).name for code in (OVERRUN, TIMEOUT, REMOVED, RESERVED)} == {
        OVERRUN: "SAMPLES_NO_LONGER_AVAILABLE",
        TIMEOUT: "SAMPLES_NOT_YET_AVAILABLE",
        REMOVED: "DEV_CANNOT_BE_ACCESSED",
        RESERVED: "PAL_RESOURCE_RESERVED",
    }
    assert codes(UNKNOWN_DEVICE).name == "INVALID_DEVICE_ID"
    assert codes(UNKNOWN_CHANNEL).name == "PHYSICAL_CHAN_DOES_NOT_EXIST"
    with pytest.raises(RigError, match=f"driver is not installed|platform|{UNKNOWN_DEVICE}"):
        NidaqRig(NidaqSettings(device="no_such_board")).open()
