from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from flexarm_bringup.verbs.health.hardware import examine_hardware
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from support.nidaq_board import Board
from support.nidaqmx_double import NidaqmxDouble
from support.nidaqmx_values import CALL_SITES, REMOVED, Fault

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

STEPS = (
    *("package", "driver", "boards", "board", "channels", "ranges", "terminals", "sampling"),
    *("outputs", "sensors"),
)


def examine(
    capsys: pytest.CaptureFixture[str],
    double: NidaqmxDouble,
    **options: Any,  # noqa: ANN401
) -> tuple[int, list[str]]:
    code = examine_hardware(NidaqSettings(**options), double)
    assert "ao.write_one_sample" not in double.calls
    assert "ao.add_ao_voltage_chan" not in double.calls
    assert all(task.closed for task in double.tasks)
    return code, capsys.readouterr().out.splitlines()


def test_healthy_board___every_step_is_ok_and_the_rest_is_reported(
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, lines = examine(capsys, NidaqmxDouble(Board()))
    assert code == 0
    assert [line.split()[1].rstrip(":") for line in lines if line.startswith("ok")] == list(STEPS)
    text = "\n".join(lines)
    assert "boards: Dev1 (PCIe-6321)" in text
    assert "NI-DAQmx 25.3.0" in text
    assert "Dev1/ao0 +0.000 V" in text
    for name in ("position_v (Dev1/ai0)", "speed_v (Dev1/ai3)"):
        assert f"{name}: mean" in text
    assert "Nothing was moved." in lines
    assert "emergency stop" in text
    assert "rig:=nidaq" in text


@pytest.mark.parametrize(
    ("change", "options", "step", "message"),
    [
        ({}, {"device": "Dev3"}, "boards", "no board Dev3; found: Dev1 (PCIe-6321)"),
        ({}, {"magnitude": "ao5"}, "channels", "no output Dev1/ao5; the board has Dev1/ao0"),
        ({}, {"sensors": ("ai0", "ai1", "ai2", "ai77")}, "channels", "no input Dev1/ai77"),
        ({"input_range_v": 5.0}, {}, "ranges", "the inputs must reach from -10 to 10 V"),
        ({"output_range_v": (0.0, 5.0)}, {}, "ranges", "the outputs must reach from 0 to 10 V"),
        ({"terminals": ["DIFF"]}, {}, "terminals", "Dev1/ai0 cannot be wired as rse, only as diff"),
        ({"fastest_hz": 1000.0}, {}, "sampling", "300 Hz on four inputs is too fast"),
        ({"outputs_v": {"Dev1/ao0": 5.0, "Dev1/ao1": 0.0}}, {}, "outputs", "ao0 holds 5.00 V"),
    ],
)
def test_board_unfit___step_says_so_and_the_later_ones_are_named(
    capsys: pytest.CaptureFixture[str],
    change: dict[str, Any],
    options: dict[str, Any],
    step: str,
    message: str,
) -> None:
    board = Board()
    for name, value in change.items():
        setattr(board, name, value)
    code, lines = examine(capsys, NidaqmxDouble(board), **options)
    assert code == 1
    (wrong,) = (line for line in lines if line.startswith("wrong"))
    assert wrong.startswith(f"wrong {step}: ")
    assert message in wrong
    later = STEPS[STEPS.index(step) + 1 :]
    assert f"        not examined: {', '.join(later)}" in lines


def shifted(channel: int, factor: float, offset_v: float) -> Callable[..., NDArray[np.float64]]:
    def wire(volts: NDArray[np.float64]) -> NDArray[np.float64]:
        volts[channel] = factor * volts[channel] + offset_v
        return volts

    return wire


@pytest.mark.parametrize(
    ("channel", "factor", "offset_v", "message"),
    [
        (0, 1.0, 12.0, "position_v (Dev1/ai0) is at the end of its range"),
        (0, 1.0, 7.5, "position_v (Dev1/ai0) is beyond the travel of 6.86 V"),
        (1, 1.0, -2.0, "base_strain_v (Dev1/ai1) is off zero by -2.0"),
        (2, 25.0, 0.0, "middle_strain_v (Dev1/ai2) has"),
        (3, 1.0, -11.0, "speed_v (Dev1/ai3) is at the end of its range"),
    ],
)
def test_sensor_implausible_at_rest___is_named(
    capsys: pytest.CaptureFixture[str], channel: int, factor: float, offset_v: float, message: str
) -> None:
    board = Board()
    board.sensors = shifted(channel, factor, offset_v)
    code, lines = examine(capsys, NidaqmxDouble(board))
    assert code == 1
    assert message in lines[-2]
    assert lines[-2].startswith("wrong sensors")


def test_board_without_readback___is_said_and_the_rest_goes_on(
    capsys: pytest.CaptureFixture[str],
) -> None:
    board = Board()
    board.has_readback = False
    code, lines = examine(capsys, NidaqmxDouble(board))
    assert code == 0
    assert any(line.startswith("ok    outputs: not tested") for line in lines)


def test_board_simulated_by_the_driver___is_distinguished(
    capsys: pytest.CaptureFixture[str],
) -> None:
    _, lines = examine(capsys, NidaqmxDouble(Board("Sim1")), device="Sim1")
    assert any("SIMULATED by the driver" in line for line in lines)


@pytest.mark.parametrize("site", [site for site in CALL_SITES if site.startswith("ai.")])
def test_board_fails_on_the_way___is_one_line_and_exit_code_1(
    capsys: pytest.CaptureFixture[str], site: str
) -> None:
    double = NidaqmxDouble(Board())
    double.faults = [Fault(site, REMOVED, times=np.inf)]
    code, lines = examine(capsys, double)
    # Closing is not part of the examination.
    assert code == (0 if site == "ai.close" else 1)
    if code:
        assert "-201003" in " ".join(lines)


def test_no_driver___names_the_command_that_installs_it(capsys: pytest.CaptureFixture[str]) -> None:
    double = NidaqmxDouble(Board())
    double.has_driver = False
    code, lines = examine(capsys, double)
    assert code == 1
    assert lines[1] == (
        "wrong driver: the NI-DAQmx driver is not installed: "
        f"{sys.executable} -m nidaqmx installdriver"
    )


def test_command___without_the_package___says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    result = CliRunner().invoke(main, ["doctor", "--hardware", "--device", "Dev2"])
    assert result.exit_code == 1
    assert result.exception is None or isinstance(result.exception, SystemExit)


def test_command___unusable_options___are_one_line() -> None:
    result = CliRunner().invoke(main, ["doctor", "--hardware", "--sensors", "ai0 ai1"])
    assert result.exit_code == 1
    assert "sensors must name 4 inputs" in result.stderr
