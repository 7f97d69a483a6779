"""Simulated rig: plant, sensor noise and converters, in real or in virtual time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flexarm_core.channels import CHANNELS, INPUT_RANGE_V, MAX_COMMAND_V
from flexarm_core.errors import SettingError
from flexarm_core.signals import MAX_CATCH_UP_S, RigSample
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

HUM_STREAM: Final = 1
"""Beside the seed: stream of the phase of the hum."""


class SimulatedRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` without hardware.

    In virtual time, the default, sample k stands at k / `rate_hz` however long the caller takes. A
    command acts the rig's `loop_delay_s` after the last sample. The same seed and the same commands
    give the same numbers on any machine.

    With a clock the rig is in real time: each call moves it on to the present with the command in
    force. After a gap longer than `MAX_CATCH_UP_S`, as of a stopped process, it moves on by that
    time only.

    Parameters
    ----------
    parameters : RigParameters, optional
        Rig; by default the thesis's rig without payload.
    rate_hz : float
        Sampling rate of virtual time, Hz.
    seed : int
        Seed of the sensor noise, and of the phase of the hum.
    clock : callable, optional
        Monotonic time in seconds, such as `time.monotonic`; without it, time is virtual.

    Attributes
    ----------
    parameters : RigParameters
        Rig with the payload of the next sample.
    plant : Plant
        Motion of the arm.
    clock : callable or None
        As given; it may be set before the rig is opened.

    Raises
    ------
    SettingError
        If the rate is not positive or the loop delay is not within a period.

    Examples
    --------
    >>> rig = SimulatedRig(seed=1)
    >>> rig.open()
    >>> rig.read().time_s
    0.0
    >>> rig.write([2.0])
    >>> round(rig.read().time_s * 300)
    1
    """

    def __init__(
        self,
        parameters: RigParameters | None = None,
        *,
        rate_hz: float = 300.0,
        seed: int = 0,
        clock: Callable[[], float] | None = None,
    ) -> None:
        if not 0.0 < rate_hz < math.inf:
            raise SettingError(f"rate_hz must be positive, got {rate_hz}")
        self.parameters = parameters if parameters is not None else RigParameters()
        if self.parameters.loop_delay_s >= 1.0 / rate_hz:
            raise SettingError(
                f"loop_delay_s must be less than the period {1.0 / rate_hz:g} s, "
                f"got {self.parameters.loop_delay_s}"
            )
        self._rate_hz = rate_hz
        self._seed = seed
        self.clock = clock
        # This import loads a compiler, which takes half a second. The module alone needs none.
        from flexarm_daq.rigs.plant import Plant  # noqa: PLC0415

        self.plant = Plant(self.parameters)
        self._noise_v = np.array(self.parameters.noise_v)
        self._hum_v = np.array(self.parameters.hum_v)
        self._adc_step_v: float = 2.0 * INPUT_RANGE_V / 2**self.parameters.adc_bits
        self._dac_step_v: float = MAX_COMMAND_V / 2**self.parameters.dac_bits
        self._is_open = False

    @property
    def has_virtual_time(self) -> bool:
        """Whether time stands still between the samples."""
        return self.clock is None

    def open(self) -> None:
        """Start at rest in the middle of the travel, at time zero, with the noise's seed."""
        self.plant.reset()
        # Compiles the equations of motion before the first deadline.
        self.plant.advance(0.0, 0.0)
        self._random = np.random.default_rng(self._seed)
        # A stream of its own: the noise of a seed is the same with and without hum.
        hum_random = np.random.default_rng((self._seed, HUM_STREAM))
        self._hum_phase_rad = 2.0 * math.pi * hum_random.random()
        self._command_v = 0.0
        self._time_s = 0.0
        self._samples = 0
        self._epoch_s = self.clock() if self.clock is not None else 0.0
        self._is_open = True

    def read(self) -> RigSample:
        """Sample the four channels with noise and quantisation; see `Rig.read`."""
        self._require_open()
        self._advance_to(self._samples / self._rate_hz)
        if self.parameters.payload_kg != self.plant.parameters.payload_kg:
            self.plant.change_payload(self.parameters.payload_kg)
        self._samples += 1
        noise_v = self._noise_v * self._random.standard_normal(len(CHANNELS))
        return RigSample(
            self._time_s, self._converted(self.plant.outputs_v() + noise_v + self._present_hum_v())
        )

    def outputs_v(self) -> NDArray[np.float64]:
        """Return the present sensor voltages without noise and quantisation, V."""
        return self.plant.outputs_v()

    def write(self, commands: Sequence[float]) -> None:
        """Command the drive through the converter, which clips at 10 V; see `Rig.write`."""
        (command_v,) = commands
        self._require_open()
        if not math.isfinite(command_v):
            raise RigError(f"command_v must be finite, got {command_v}")
        answered = max(self._samples - 1, 0) / self._rate_hz
        self._advance_to(answered + self.parameters.loop_delay_s)
        code = min(round(abs(command_v) / self._dac_step_v), 2**self.parameters.dac_bits - 1)
        self._command_v = math.copysign(code * self._dac_step_v, command_v)

    def change_payload(self, payload_kg: float) -> None:
        """Put another mass on the tip at the next sample; any thread may call.

        Parameters
        ----------
        payload_kg : float
            Point mass at the tip, kg.

        Raises
        ------
        SettingError
            If the mass is negative or not finite.
        """
        self.parameters = replace(self.parameters, payload_kg=payload_kg)

    def safe_stop(self) -> None:
        """Set the drive to zero; never raises."""
        if self._is_open:
            self.write([0.0])

    def close(self) -> None:
        """Set the drive to zero and close; `open` starts again from rest."""
        self.safe_stop()
        self._is_open = False

    def _require_open(self) -> None:
        if not self._is_open:
            raise RigError("the simulated rig is not open: call open() first")

    def _present_hum_v(self) -> NDArray[np.float64]:
        turned_rad = 2.0 * math.pi * self.parameters.hum_hz * self._time_s
        hum_v: NDArray[np.float64] = self._hum_v * math.sin(turned_rad + self._hum_phase_rad)
        return hum_v

    def _advance_to(self, virtual_s: float) -> None:
        now_s = virtual_s if self.clock is None else self.clock() - self._epoch_s
        if now_s > self._time_s:
            gap_s = now_s - self._time_s
            self.plant.advance(
                self._command_v + self.parameters.disturbance_v,
                gap_s if self.clock is None else min(gap_s, MAX_CATCH_UP_S),
            )
            self._time_s = now_s

    def _converted(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        half_range = 2 ** (self.parameters.adc_bits - 1)
        codes: NDArray[np.float64] = np.clip(
            np.rint(volts / self._adc_step_v), -half_range, half_range - 1
        )
        return codes * self._adc_step_v
