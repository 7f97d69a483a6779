"""Hardware examination: the board and the sensors at rest, with nothing moved.

One step after the other; the first that fails ends it, because the next ones build on it. No step
opens an output.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flexarm_bringup.console import terminal
from flexarm_bringup.console.called import as_called
from flexarm_core.channels import CHANNELS, INPUT_RANGE_V, MAX_COMMAND_V, TRAVEL_V
from flexarm_daq.rigs.nidaq.driver import load_nidaqmx, named_errors
from flexarm_daq.rigs.nidaq.terminals import DIRECTION_HIGH_V, Sensors
from flexarm_daq.rigs.rig_parameters import THESIS_NOISE_V
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from numpy.typing import NDArray

    from flexarm_daq.rigs.nidaq.driver import Nidaqmx
    from flexarm_daq.rigs.nidaq.terminals import NidaqSettings

_REST_S: Final = 1.0
_MAX_NOISE: Final = 3.0
_MAX_OFFSET_V: Final = 1.0
_SATURATED_V: Final = INPUT_RANGE_V - 0.05
_ZERO_V: Final = 0.05
_READBACK_TIMEOUT_S: Final = 1.0

_REMAINS: Final = (
    "What remains, and only you can do:",
    "  1. Press the emergency stop: the motor must lose its power whatever the computer does.",
    "  2. Check the relay and the external watchdog, as docs/hardware.md says.",
    "  3. Turn the arm by hand to the middle; its way must be free.",
    "  4. flexarm run flexarm_daq daq_node --ros-args -p rig:=nidaq -p autostart:=true",
    "     It pulses the motor by about 6 degrees and refuses when a sign is wrong.",
)


class _Examination:
    """Findings so far on the package, the driver and the board."""

    def __init__(self, settings: NidaqSettings, nidaqmx: Nidaqmx | None) -> None:
        self._settings = settings
        self._given = nidaqmx

    def package(self) -> str:
        self._nidaqmx = self._given if self._given is not None else load_nidaqmx()
        return f"nidaqmx {getattr(self._nidaqmx, '__version__', '')}".rstrip()

    def driver(self) -> str:
        with named_errors(self._nidaqmx, "driver"):
            self._system = self._nidaqmx.system.System.local()
            version = self._system.driver_version
        return f"NI-DAQmx {version.major_version}.{version.minor_version}.{version.update_version}"

    def boards(self) -> str:
        with named_errors(self._nidaqmx, "boards"):
            found = {each.name: each.product_type for each in self._system.devices}
        listing = ", ".join(f"{name} ({kind})" for name, kind in found.items())
        if self._settings.device not in found:
            raise RigError(
                f"no board {self._settings.device}; found: {listing or 'none'}: connect it, or "
                "name another with --device"
            )
        return listing

    def board(self) -> str:
        with named_errors(self._nidaqmx, self._settings.device):
            self._device: Any = self._nidaqmx.system.Device(self._settings.device)
            kind, is_simulated = self._device.product_type, self._device.is_simulated
        return f"{kind}{', SIMULATED by the driver: there is no hardware' * is_simulated}"

    def channels(self) -> str:
        settings = self._settings
        with named_errors(self._nidaqmx, settings.device):
            inputs = [each.name for each in self._device.ai_physical_chans]
            outputs = [each.name for each in self._device.ao_physical_chans]
        wanted = [
            *((settings.path(name), "input", inputs) for name in settings.sensors),
            (settings.path(settings.magnitude), "output", outputs),
            (settings.path(settings.direction), "output", outputs),
        ]
        for path, kind, have in wanted:
            if path not in have:
                raise RigError(f"no {kind} {path}; the board has {', '.join(have) or 'none'}")
        return f"{len(inputs)} inputs and {len(outputs)} outputs, those of the rig among them"

    def ranges(self) -> str:
        with named_errors(self._nidaqmx, self._settings.device):
            inputs = _pairs(self._device.ai_voltage_rngs)
            outputs = _pairs(self._device.ao_voltage_rngs)
        _require_range("inputs", inputs, -INPUT_RANGE_V, INPUT_RANGE_V)
        _require_range("outputs", outputs, 0.0, max(MAX_COMMAND_V, DIRECTION_HIGH_V))
        return f"inputs {_listing(inputs)}; outputs {_listing(outputs)}"

    def terminals(self) -> str:
        wanted = self._settings.terminals
        if wanted == "default":
            return "as the board prefers"
        for name in self._settings.sensors:
            path = self._settings.path(name)
            with named_errors(self._nidaqmx, path):
                (found,) = (each for each in self._device.ai_physical_chans if each.name == path)
                have = [each.name.lower() for each in found.ai_term_cfgs]
            if wanted not in have:
                raise RigError(
                    f"{path} cannot be wired as {wanted}, only as {', '.join(have)}: choose with "
                    "--terminals"
                )
        return f"{wanted} on all four inputs"

    def rate(self) -> str:
        with named_errors(self._nidaqmx, self._settings.device):
            fastest_hz = self._device.ai_max_multi_chan_rate
        needed_hz = len(CHANNELS) * self._settings.rate_hz
        if needed_hz > fastest_hz:
            raise RigError(
                f"{self._settings.rate_hz:g} Hz on four inputs is too fast, the board converts "
                f"{fastest_hz:g} values per second: lower --rate"
            )
        return f"{self._settings.rate_hz:g} Hz, at most {fastest_hz / len(CHANNELS):g} Hz"

    def sensors(self) -> str:
        volts = self._at_rest()
        complaints = []
        for number, (channel, noise_v) in enumerate(zip(CHANNELS, THESIS_NOISE_V, strict=True)):
            samples_v = volts[:, number]
            where = f"{channel.name} ({self._settings.path(self._settings.sensors[number])})"
            terminal.CONSOLE.print(
                f"        {where}: mean {samples_v.mean():+.3f} V, noise {samples_v.std():.4f} V, "
                f"from {samples_v.min():+.3f} to {samples_v.max():+.3f} V"
            )
            reason = _implausible(samples_v, noise_v, is_position=number == 0)
            if reason:
                complaints.append(f"{where} {reason}")
        if complaints:
            raise RigError("; ".join(complaints))
        return "plausible at rest"

    def outputs(self) -> str:
        """Read what the outputs hold, on boards that can: never open them."""
        settings = self._settings
        try:
            held_v = {name: self._held_v(name) for name in (settings.magnitude, settings.direction)}
        except RigError as error:
            return f"not tested, this board does not read its outputs back ({error})"
        if abs(held_v[settings.magnitude]) > _ZERO_V:
            raise RigError(
                f"{settings.path(settings.magnitude)} holds {held_v[settings.magnitude]:.2f} V: "
                "the drive would turn the motor; press the emergency stop, then reset the board"
            )
        return ", ".join(f"{settings.path(name)} {volts:+.3f} V" for name, volts in held_v.items())

    def steps(self) -> tuple[tuple[str, Callable[[], str]], ...]:
        """Return the steps in their order."""
        return (
            ("package", self.package),
            ("driver", self.driver),
            ("boards", self.boards),
            ("board", self.board),
            ("channels", self.channels),
            ("ranges", self.ranges),
            ("terminals", self.terminals),
            ("sampling", self.rate),
            ("outputs", self.outputs),
            ("sensors", self.sensors),
        )

    def _at_rest(self) -> NDArray[np.float64]:
        sensors = Sensors(self._nidaqmx, self._settings)
        try:
            sensors.open()
            count = math.ceil(_REST_S * self._settings.rate_hz)
            return np.array([sensors.read().outputs for _ in range(count)])
        finally:
            sensors.close()

    def _held_v(self, output: str) -> float:
        path = f"{self._settings.device}/_{output}_vs_aognd"
        held_v = np.zeros(1)
        with named_errors(self._nidaqmx, path):
            task = self._nidaqmx.Task()
            try:
                task.ai_channels.add_ai_voltage_chan(
                    path, min_val=-INPUT_RANGE_V, max_val=INPUT_RANGE_V
                )
                reader = self._nidaqmx.stream_readers.AnalogMultiChannelReader(task.in_stream)
                reader.read_one_sample(held_v, _READBACK_TIMEOUT_S)
            finally:
                task.close()
        return float(held_v[0])


def examine_hardware(settings: NidaqSettings, nidaqmx: Nidaqmx | None = None) -> int:
    """Examine a rig step by step and print what remains to do; return 0 if all is right, else 1.

    Parameters
    ----------
    settings : NidaqSettings
        Connections of the rig.
    nidaqmx : Nidaqmx, optional
        The package; imported by default.
    """
    return follow_steps(_Examination(settings, nidaqmx).steps(), _REMAINS)


def follow_steps(
    steps: Sequence[tuple[str, Callable[[], str]]],
    remains: Sequence[str],
    moving: Collection[str] = (),
) -> int:
    """Print what each step finds, up to the first that fails; return 0 if all is right, else 1.

    Parameters
    ----------
    steps : sequence of (str, callable)
        Names, and functions that return a finding or raise `RigError`.
    remains : sequence of str
        Lines on what remains to do.
    moving : collection of str
        Names of the steps that move the arm.
    """
    moved = ""
    for number, (name, examine) in enumerate(steps):
        moved = "" if name in moving else "Nothing was moved."
        try:
            found = examine()
        except RigError as error:
            terminal.marked("wrong", "red", f" {name}: {error}")
            left = ", ".join(later for later, _ in steps[number + 1 :])
            if left:
                terminal.CONSOLE.print(f"        not examined: {left}")
            terminal.CONSOLE.print(f"{moved} Fix this first, then look again.".strip())
            return 1
        terminal.marked("ok", "green", f"    {name}: {found}")
    for line in filter(None, (moved, *remains)):
        terminal.CONSOLE.print(as_called(line))
    return 0


def _pairs(flat: list[float]) -> list[tuple[float, float]]:
    """Turn the driver's low, high, low, high into pairs."""
    return list(zip(flat[::2], flat[1::2], strict=True))


def _listing(pairs: list[tuple[float, float]]) -> str:
    return ", ".join(f"{low_v:g} to {high_v:g} V" for low_v, high_v in pairs) or "none"


def _require_range(what: str, have: list[tuple[float, float]], low_v: float, high_v: float) -> None:
    if not any(low <= low_v and high_v <= high for low, high in have):
        raise RigError(
            f"the {what} must reach from {low_v:g} to {high_v:g} V, the board's are "
            f"{_listing(have)}: take another board"
        )


def _implausible(samples_v: NDArray[np.float64], noise_v: float, *, is_position: bool) -> str:
    """Say what is wrong with a channel at rest, or nothing."""
    if np.abs(samples_v).max() >= _SATURATED_V:
        return "is at the end of its range: check its supply and wires"
    if samples_v.std() > _MAX_NOISE * noise_v:
        return (
            f"has {samples_v.std():.3f} V of noise, more than {_MAX_NOISE * noise_v:.3f} V: is the "
            "arm at rest? Else check wire, shield and ground: an open input looks like this"
        )
    if is_position and abs(samples_v.mean()) > TRAVEL_V:
        return f"is beyond the travel of {TRAVEL_V:.2f} V: check its supply and wires"
    if not is_position and abs(samples_v.mean()) > _MAX_OFFSET_V:
        return f"is off zero by {samples_v.mean():+.2f} V at rest: balance its amplifier"
    return ""
