"""Channels of the rig on a National Instruments board: inputs, outputs and their terminals.

The board's own clock samples the four sensors on ACH0 to ACH3. The drive takes two voltages
(section 2.3): the magnitude of the current from DAC0, 0 to 10 V, and its direction from DAC1, 0 or
5 V. Each output has its own task, which fixes their order: the magnitude is zero before the
direction changes.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flexarm_core.channels import CHANNELS, INPUT_RANGE_V, MAX_COMMAND_V
from flexarm_core.errors import SettingError
from flexarm_daq.rigs.nidaq.driver import named_errors, succeeds
from flexarm_daq.rigs.rig_protocol import RigError, RigSample

if TYPE_CHECKING:
    from flexarm_daq.rigs.nidaq.driver import Nidaqmx

DIRECTION_HIGH_V: Final = 5.0
"""Level of DAC1 for counter-clockwise rotation seen from the top; 0 V is clockwise."""

TERMINALS: Final = ("rse", "nrse", "diff", "default")
"""Wirings of an input: against ground, against AISENSE, as a pair, or the board's default."""

_BUFFER_S: Final = 10.0
_TIMEOUT_PERIODS: Final = 3
_SHORTEST_TIMEOUT_S: Final = 0.01
_WRITE_TIMEOUT_S: Final = 0.05
_RATE_TOLERANCE: Final = 1e-3


@dataclass(frozen=True)
class NidaqSettings:
    """Terminals of the rig; by default as in section 2.3.

    Attributes
    ----------
    device : str
        Name that the driver gives to the board.
    sensors : tuple of str
        Inputs of position, base gauge, middle gauge and speed.
    magnitude, direction : str
        Outputs of the current's magnitude and direction.
    terminals : str
        Wiring of the inputs, one of `TERMINALS`.
    high_is_positive : bool
        True if 5 V on the direction is the positive sense of the position.
    rate_hz : float
        Sampling rate, Hz.

    Raises
    ------
    SettingError
        If a name is empty or used twice, or a value is out of range.
    """

    device: str = "Dev1"
    sensors: tuple[str, ...] = ("ai0", "ai1", "ai2", "ai3")
    magnitude: str = "ao0"
    direction: str = "ao1"
    terminals: str = "rse"
    high_is_positive: bool = True
    rate_hz: float = 300.0

    def __post_init__(self) -> None:
        if len(self.sensors) != len(CHANNELS):
            raise SettingError(
                f"sensors must name {len(CHANNELS)} inputs, position, base gauge, middle gauge and "
                f"speed, got {', '.join(self.sensors) or 'none'}"
            )
        names = (*self.sensors, self.magnitude, self.direction)
        for name in (self.device, *names):
            if not name or not name.isprintable() or set(name) & set(" ,:/"):
                raise SettingError(f"'{name}' names no board or channel: write such as Dev1 or ai0")
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise SettingError(f"{', '.join(sorted(twice))} is used for two channels")
        if self.terminals not in TERMINALS:
            raise SettingError(f"terminals must be one of {TERMINALS}, got '{self.terminals}'")
        if not 0.0 < self.rate_hz < math.inf:
            raise SettingError(f"rate_hz must be positive, got {self.rate_hz}")

    def path(self, channel: str) -> str:
        """Return a channel's name for the driver, such as ``Dev1/ai0``."""
        return f"{self.device}/{channel}"


class Sensors:
    """Four inputs, sampled by the clock of the board."""

    def __init__(self, nidaqmx: Nidaqmx, settings: NidaqSettings) -> None:
        self._nidaqmx = nidaqmx
        self._settings = settings
        paths = [settings.path(name) for name in settings.sensors]
        self._what = f"sensors {', '.join(paths)}"
        self._volts = np.zeros(len(CHANNELS))
        self._timeout_s = max(_TIMEOUT_PERIODS / settings.rate_hz, _SHORTEST_TIMEOUT_S)
        self._task: Any = None

    def open(self) -> None:
        """Start the sampling.

        Raises
        ------
        RigError
            If the board refuses; `close` then ends the tasks that were begun.
        """
        settings, constants = self._settings, self._nidaqmx.constants
        with named_errors(self._nidaqmx, self._what):
            self._task = self._nidaqmx.Task()
        for channel, name in zip(CHANNELS, settings.sensors, strict=True):
            path = settings.path(name)
            with named_errors(self._nidaqmx, f"{path} ({channel.name})"):
                self._task.ai_channels.add_ai_voltage_chan(
                    path,
                    terminal_config=constants.TerminalConfiguration[settings.terminals.upper()],
                    min_val=-INPUT_RANGE_V,
                    max_val=INPUT_RANGE_V,
                )
        with named_errors(self._nidaqmx, self._what):
            self._task.timing.cfg_samp_clk_timing(
                settings.rate_hz,
                sample_mode=constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=math.ceil(_BUFFER_S * settings.rate_hz),
            )
            rate_hz = self._task.timing.samp_clk_rate
        if abs(rate_hz - settings.rate_hz) > _RATE_TOLERANCE * settings.rate_hz:
            raise RigError(
                f"{self._what}: the board's clock makes {rate_hz:g} Hz of rate_hz = "
                f"{settings.rate_hz:g}: choose a rate it can make"
            )
        with named_errors(self._nidaqmx, self._what):
            self._reader = self._nidaqmx.stream_readers.AnalogMultiChannelReader(
                self._task.in_stream
            )
            # The shape is right, and its check would cost a call of the driver per sample.
            self._reader.verify_array_shape = False
            self._task.start()
        self._rate_hz: float = rate_hz
        self._taken = 0

    def read(self) -> RigSample:
        """Wait for the next sample of the board's clock; of several samples take the newest.

        Raises
        ------
        RigError
            If no sample came within three periods, or the board failed.
        """
        with named_errors(self._nidaqmx, self._what):
            for _ in range(max(1, self._task.in_stream.avail_samp_per_chan)):
                self._reader.read_one_sample(self._volts, self._timeout_s)
                self._taken += 1
        return RigSample((self._taken - 1) / self._rate_hz, self._volts.copy())

    def close(self) -> None:
        """End the sampling; never raises, does nothing when closed."""
        task, self._task = self._task, None
        if task is not None:
            succeeds(self._nidaqmx, task.close)


class _Output:
    """One analogue output, written on demand."""

    def __init__(self, nidaqmx: Nidaqmx, path: str, name: str, max_v: float) -> None:
        self._nidaqmx = nidaqmx
        self._path = path
        self._what = f"{path} ({name})"
        self._max_v = max_v
        self._task: Any = None
        self._writer: Any = None

    def open(self) -> None:
        """Open the channel without a change of its voltage."""
        with named_errors(self._nidaqmx, self._what):
            self._task = self._nidaqmx.Task()
            self._task.ao_channels.add_ao_voltage_chan(self._path, min_val=0.0, max_val=self._max_v)
            writer = self._nidaqmx.stream_writers.AnalogSingleChannelWriter(
                self._task.out_stream, auto_start=False
            )
            self._task.start()
        self._writer = writer

    def write(self, volts: float) -> None:
        """Put a voltage on the channel."""
        if self._writer is None:
            raise RigError(f"{self._what} is not open")
        with named_errors(self._nidaqmx, self._what):
            self._writer.write_one_sample(volts, _WRITE_TIMEOUT_S)

    def close(self) -> None:
        """Release the channel, which keeps its voltage; never raises."""
        task, self._task, self._writer = self._task, None, None
        if task is not None:
            succeeds(self._nidaqmx, task.close)


class Drive:
    """Magnitude and direction of the current, each written on demand."""

    def __init__(self, nidaqmx: Nidaqmx, settings: NidaqSettings) -> None:
        self._nidaqmx = nidaqmx
        self._settings = settings
        self._magnitude = _Output(
            nidaqmx, settings.path(settings.magnitude), "magnitude", MAX_COMMAND_V
        )
        self._direction = _Output(
            nidaqmx, settings.path(settings.direction), "direction", DIRECTION_HIGH_V
        )
        self._level_v: float | None = None
        self._is_ours = False

    def open(self) -> None:
        """Open both outputs, and set the magnitude to zero before anything else.

        Raises
        ------
        RigError
            If the board refuses; `close` then ends the tasks that were begun.
        """
        self._magnitude.open()
        self._is_ours = True
        self._magnitude.write(0.0)
        self._direction.open()

    def write(self, command_v: float) -> None:
        """Put out magnitude and direction of a command, clipped beyond 10 V.

        Raises
        ------
        RigError
            If the board refuses.
        """
        if command_v != 0.0:
            self._turn_to(positive=command_v > 0.0)
        self._magnitude.write(min(abs(command_v), MAX_COMMAND_V))

    def stop(self) -> None:
        """Set the magnitude to zero by the running task, by a new one, or by resetting the board.

        Raises
        ------
        RigError
            If all of that failed on a board that was in use by this drive.
        """
        with suppress(RigError):
            self._magnitude.write(0.0)
            return
        self._magnitude.close()
        try:
            self._magnitude.open()
            self._magnitude.write(0.0)
        except RigError:
            # A reset would also stop another program that holds the board.
            if self._is_ours and not self._resets():
                raise

    def close(self) -> None:
        """Release both outputs, which keep their voltages; never raises."""
        self._magnitude.close()
        self._direction.close()
        self._is_ours = False

    def _turn_to(self, *, positive: bool) -> None:
        high = positive == self._settings.high_is_positive
        level_v = DIRECTION_HIGH_V if high else 0.0
        if level_v != self._level_v:
            # Unknown until the write has succeeded.
            self._level_v = None
            self._magnitude.write(0.0)
            self._direction.write(level_v)
            self._level_v = level_v

    def _resets(self) -> bool:
        system, device = self._nidaqmx.system, self._settings.device
        self._level_v = None
        return succeeds(self._nidaqmx, lambda: system.Device(device).reset_device())
