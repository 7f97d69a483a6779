from __future__ import annotations

import inspect
import re
import sys
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.driver import load_nidaqmx
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from flexarm_daq.rigs.rig_protocol import RigError
from support import nidaqmx_double as double_module
from support.nidaq_session import make
from support.nidaqmx_system import Device
from support.nidaqmx_values import (
    NOT_SUPPORTED,
    OVERRUN,
    REMOVED,
    RESERVED,
    TIMEOUT,
    UNKNOWN_CHANNEL,
    UNKNOWN_DEVICE,
    AcquisitionType,
    DaqNotSupportedError,
    TerminalConfiguration,
)


def test_two_rigs_on_one_board___second_is_refused_and_first_goes_on() -> None:
    board, double, first = make()
    first.open()
    first.write([2.0])
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
        raise DaqNotSupportedError(site)

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
        (Device.reset_device, real.system.Device.reset_device),
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
        (TerminalConfiguration, real.constants.TerminalConfiguration),
        (AcquisitionType, real.constants.AcquisitionType),
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
