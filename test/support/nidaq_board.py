"""Data acquisition board with the arm behind it, for the double of its driver's API."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.channels import CHANNELS
from flexarm_daq.rigs.plant import Plant
from flexarm_daq.rigs.rig_parameters import RigParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


class Write(NamedTuple):
    """One voltage put on an output."""

    time_s: float
    channel: str
    volts: float


class VirtualClock:
    """Clock that moves only when somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        """Return the time."""
        return self.now_s

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self.now_s += max(0.0, seconds)


class PatientClock(VirtualClock):
    """Such a clock, not faster than the machine's: the arm waits while the machine stalls."""

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(max(0.0, seconds))
        super().sleep(seconds)


class Board:
    """One board and the rig that hangs on it.

    `ao0` and `ao1` are what the outputs hold, whoever put it there and however long ago.
    """

    def __init__(
        self,
        name: str = "Dev1",
        *,
        clock: VirtualClock | None = None,
        parameters: RigParameters | None = None,
        seed: int = 0,
        low_is_positive: bool = False,
    ) -> None:
        self.name = name
        self.clock = clock if clock is not None else VirtualClock()
        self.outputs_v = {f"{name}/ao0": 0.0, f"{name}/ao1": 0.0}
        self.inputs = [f"{name}/ai{number}" for number in range(16)]
        self.input_range_v = 10.0
        self.output_range_v = (-10.0, 10.0)
        self.terminals = ["RSE", "NRSE", "DIFF"]
        self.fastest_hz = 500_000.0
        self.has_readback = True
        self.sensors: Callable[[NDArray[np.float64]], NDArray[np.float64]] = lambda volts: volts
        self.writes: list[Write] = []
        self.on_write: Callable[[Write], None] = self.writes.append
        self.resets = 0
        self.holders: dict[str, object] = {}
        self._parameters = parameters if parameters is not None else RigParameters()
        self._plant = Plant(self._parameters)
        self._plant.reset()
        self._plant.advance(0.0, 0.0)
        self._plant_s = self.clock()
        self._random = np.random.default_rng(seed)
        self._low_is_positive = low_is_positive

    @property
    def command_v(self) -> float:
        """Command that the drive makes of the two voltages."""
        magnitude_v = max(0.0, self.outputs_v[f"{self.name}/ao0"])
        high = self.outputs_v[f"{self.name}/ao1"] > 2.5
        return magnitude_v if high != self._low_is_positive else -magnitude_v

    def advance(self, now_s: float) -> None:
        """Move the arm on with the voltages as they are."""
        if now_s > self._plant_s:
            self._plant.advance(self.command_v, now_s - self._plant_s)
            self._plant_s = now_s

    def put(self, channel: str, volts: float) -> None:
        """Put a voltage on an output."""
        self.advance(self.clock())
        self.outputs_v[channel] = volts
        self.on_write(Write(self.clock(), channel, volts))

    def sample(self) -> NDArray[np.float64]:
        """Return the sensors as the converter sees them."""
        noise_v = np.array(self._parameters.noise_v) * self._random.standard_normal(len(CHANNELS))
        step_v = 2.0 * self.input_range_v / 2**self._parameters.adc_bits
        codes = np.rint(self.sensors(self._plant.outputs_v() + noise_v) / step_v)
        volts: NDArray[np.float64] = np.clip(
            codes * step_v, -self.input_range_v, self.input_range_v - step_v
        )
        return volts
