"""Many simulated rigs that are sampled together, for learning and for studies over many arms.

Each rig moves and is measured as a `flexarm_daq.rigs.simulated.SimulatedRig` in virtual time. What
makes many of them fast is that one compiled call moves all, with transition matrices that are kept.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from flexarm_core.channels import CHANNELS, INPUT_RANGE_V, MAX_COMMAND_V
from flexarm_core.compilation import compiled
from flexarm_core.errors import SettingError
from flexarm_daq.rigs import integrator
from flexarm_daq.rigs.beam import arm_modes
from flexarm_daq.rigs.equations import COLUMNS, RECORD
from flexarm_daq.rigs.plant import equations_of
from flexarm_daq.rigs.simulated import HUM_STREAM

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.integrator import Block, Lanes
    from flexarm_daq.rigs.rig_parameters import RigParameters

_KINDS = [(name, np.float64, (4, COLUMNS)) for name in ("half", "whole")]
_WAY = np.dtype((np.record, [("steps", np.int64), ("step_s", np.float64), *_KINDS]))
"""`flexarm_daq.rigs.equations.Way` in an array."""
_MANY: Final = (0,) * 8
"""Lanes of a block for many rigs: two vectors of four fill the pipeline better than one."""
_WORTH: Final = 3
"""A block of fewer rigs takes longer than each of them alone."""
_NOISE_SAMPLES: Final = 256
"""Noise is drawn for so many samples at once."""
_KEPT_RIGS: Final = 4096
"""Equations of the last so many different rigs are kept."""


class RigBatch:
    """Simulated rigs in virtual time, each with its own parameters and its own noise.

    Command k acts from the rig's `loop_delay_s` after sample k until the next one acts.

    Parameters
    ----------
    rigs : int
        Number of rigs; each has to be put to rest by `rest` first.
    rate_hz : float
        Sampling rate, Hz.

    Attributes
    ----------
    outputs_v : ndarray, (rigs, 4)
        Voltages at the last sample, without noise and converters.
    command_v : ndarray, (rigs,)
        Commands in force, as the drives' converters wrote them, V.

    Raises
    ------
    SettingError
        If there is no rig, or the rate is not positive.

    Examples
    --------
    >>> from flexarm_daq.rigs.rig_parameters import RigParameters
    >>> batch = RigBatch(2)
    >>> for rig, payload_kg in enumerate((0.0, 0.4)):
    ...     batch.rest(rig, RigParameters(payload_kg=payload_kg), seed=rig)
    >>> batch.write(np.array([1.0, 2.0]), np.array([True, True]))
    >>> batch.read().shape
    (2, 4)
    """

    def __init__(self, rigs: int, *, rate_hz: float = 300.0) -> None:
        if rigs < 1:
            raise SettingError(f"rigs must be at least 1, got {rigs}")
        if not 0.0 < rate_hz < math.inf:
            raise SettingError(f"rate_hz must be positive, got {rate_hz}")
        self.outputs_v = np.zeros((rigs, len(CHANNELS)))
        self.command_v = np.zeros(rigs)
        self._rate_hz = rate_hz
        self._states = np.zeros((rigs, 2, COLUMNS))
        self._records = np.zeros(rigs, RECORD)
        self._ways = np.zeros((rigs, 2), _WAY)
        self._neighbours = np.arange(rigs)
        self._samples = np.zeros(rigs, np.int64)
        self._random = [np.random.default_rng() for _ in range(rigs)]
        self._noise = np.zeros((rigs, _NOISE_SAMPLES, len(CHANNELS)))
        self._noise_v = np.zeros((rigs, len(CHANNELS)))
        self._hum_v = np.zeros((rigs, len(CHANNELS)))
        self._hum_rad = np.zeros((rigs, 2))
        self._adc_step_v, self._adc_top = np.zeros((rigs, 1)), np.zeros((rigs, 1))
        self._dac_step_v, self._dac_top = np.zeros(rigs), np.zeros(rigs)

    @property
    def samples(self) -> NDArray[np.int64]:
        """Number of commands since each rig was put to rest, (rigs,)."""
        return self._samples

    def rest(self, rig: int, parameters: RigParameters, seed: int) -> None:
        """Put a rig to rest in the middle of the travel, at time zero, with a seed of its noise.

        Parameters
        ----------
        rig : int
            Its number.
        parameters : RigParameters
            Rig from now on. Modes and transitions are computed once for equal parameters.
        seed : int
            Seed of the sensor noise and of the hum's phase, as of `SimulatedRig`.

        Raises
        ------
        SettingError
            If the loop delay is not within a period.
        """
        record, ways = _kept(parameters, self._rate_hz)
        self._records[rig] = record[0]
        same_steps = np.array_equal(self._ways["steps"][rig], ways["steps"])
        self._ways[rig] = ways
        if not same_steps:
            # Rigs with equal numbers of sub-steps in a period are neighbours: they move together.
            self._neighbours = np.lexsort(self._ways["steps"].T)
        self._states[rig] = 0.0
        self.outputs_v[rig] = 0.0
        self.command_v[rig] = 0.0
        self._samples[rig] = 0
        self._random[rig] = np.random.default_rng(seed)
        self._draw_noise(np.array([rig]))
        phase_rad = 2.0 * math.pi * np.random.default_rng((seed, HUM_STREAM)).random()
        self._hum_rad[rig] = phase_rad, 2.0 * math.pi * parameters.hum_hz / self._rate_hz
        self._noise_v[rig], self._hum_v[rig] = parameters.noise_v, parameters.hum_v
        self._adc_top[rig] = 2 ** (parameters.adc_bits - 1)
        self._adc_step_v[rig] = INPUT_RANGE_V / self._adc_top[rig]
        self._dac_top[rig] = 2**parameters.dac_bits - 1
        self._dac_step_v[rig] = MAX_COMMAND_V / 2**parameters.dac_bits

    def read(self) -> NDArray[np.float64]:
        """Return what the converters read at the last sample, with noise, V, (rigs, 4)."""
        noise = self._noise[np.arange(len(self._noise)), self._samples % _NOISE_SAMPLES]
        volts = self.outputs_v + self._noise_v * noise
        if self._hum_v.any():
            turned_rad = self._hum_rad[:, 0] + self._hum_rad[:, 1] * self._samples
            volts += self._hum_v * np.sin(turned_rad)[:, np.newaxis]
        codes = np.rint(volts / self._adc_step_v)
        sensed_v: NDArray[np.float64] = (
            np.clip(codes, -self._adc_top, self._adc_top - 1) * self._adc_step_v
        )
        return sensed_v

    def write(self, command_v: NDArray[np.float64], moving: NDArray[np.bool_]) -> None:
        """Command drives through their converters, and move their rigs on to the next sample.

        Parameters
        ----------
        command_v : ndarray, (rigs,)
            Commands, V; beyond 10 V the converters clip.
        moving : ndarray of bool, (rigs,)
            Rigs that move; the others stay as they are.

        Raises
        ------
        SettingError
            If the commands are not one finite number for each rig.
        """
        if command_v.shape != self.command_v.shape or not np.isfinite(command_v).all():
            raise SettingError(
                f"command_v must be {len(self.command_v)} finite numbers, one for each rig"
            )
        codes = np.minimum(np.rint(np.abs(command_v) / self._dac_step_v), self._dac_top)
        driven_v = np.copysign(codes * self._dac_step_v, command_v)
        both_v = np.column_stack([self.command_v, driven_v])
        rigs = self._neighbours[moving[self._neighbours]]
        _advance_all(self._states, self._records, both_v, self._ways, rigs, self.outputs_v)
        self.command_v[rigs] = driven_v[rigs]
        self._samples[rigs] += 1
        self._draw_noise(rigs[self._samples[rigs] % _NOISE_SAMPLES == 0])

    def _draw_noise(self, rigs: NDArray[np.int64]) -> None:
        for rig in rigs.tolist():
            self._random[rig].standard_normal(out=self._noise[rig])


@lru_cache(_KEPT_RIGS)
def _kept(parameters: RigParameters, rate_hz: float) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return the record of a rig's equations, (1,), and the ways of its period, (2,)."""
    period_s, delay_s = 1.0 / rate_hz, parameters.loop_delay_s
    if delay_s >= period_s:
        raise SettingError(
            f"loop_delay_s must be less than the period {period_s:g} s, got {delay_s}"
        )
    record = np.array([equations_of(parameters, arm_modes(parameters))], RECORD)
    parts_s = (delay_s, period_s - delay_s)
    return record, np.array([tuple(integrator.way_of(record[0], each)) for each in parts_s], _WAY)


@compiled
def _advance_all(  # noqa: PLR0917 - compiled code takes no keywords only
    states: NDArray[np.float64],
    records: NDArray[np.void],
    command_v: NDArray[np.float64],
    ways: NDArray[np.void],
    moving: NDArray[np.int64],
    outputs_v: NDArray[np.float64],
) -> None:
    """Move rigs of many on by a period and sample them, as `integrator.run` does with one.

    Parameters
    ----------
    states : ndarray, (rigs, 2, COLUMNS)
        Positions and velocities, changed in place.
    records : ndarray of RECORD, (rigs,)
        `Equations` of each.
    command_v : ndarray, (rigs, 2)
        Command in force, and the one that follows it within the period, V.
    ways : ndarray of _WAY, (rigs, 2)
        Sub-steps of the period before the new command acts, and after.
    moving : ndarray of int
        Numbers of the rigs that move. Neighbours with equal numbers of sub-steps move together.
    outputs_v : ndarray, (rigs, 4)
        Takes their noise-free voltages at the end of the period, V.
    """
    one, many = np.empty(integrator.ROWS), np.empty(integrator.ROWS * len(_MANY))
    done = 0
    while done < len(moving):
        rigs = _alike(moving[done : done + len(_MANY)], ways)
        done += len(rigs)
        if len(rigs) < _WORTH:
            for i in range(len(rigs)):
                _advance_block(
                    one, states, records, command_v, ways, rigs[i : i + 1], integrator.ONE
                )
        else:
            _advance_block(many, states, records, command_v, ways, rigs, _MANY)
        for rig in rigs:
            integrator.read_out(states[rig], records[rig].output_rows, outputs_v[rig])


@compiled
def _advance_block(  # noqa: PLR0917 - compiled code takes no keywords only
    block: Block,
    states: NDArray[np.float64],
    records: NDArray[np.void],
    command_v: NDArray[np.float64],
    ways: NDArray[np.void],
    rigs: NDArray[np.int64],
    lanes: Lanes,
) -> None:
    """Move at most as many rigs as there are lanes, with equal numbers of sub-steps."""
    for lane in range(len(lanes)):
        # Lanes without a rig of their own compute the last one's again, unused.
        rig = rigs[min(lane, len(rigs) - 1)]
        integrator.take_rig(block, lane, records[rig], lanes)
        integrator.take_state(block, lane, states[rig], lanes)
    for part in range(2):
        steps = ways[rigs[0], part].steps
        if steps < 1:
            continue
        for lane in range(len(lanes)):
            rig = rigs[min(lane, len(rigs) - 1)]
            integrator.take_way(
                block, lane, records[rig], command_v[rig, part], ways[rig, part], lanes
            )
        integrator.move(block, steps, lanes)
    for lane in range(len(rigs)):
        integrator.give_state(block, lane, states[rigs[lane]], lanes)


@compiled
def _alike(rigs: NDArray[np.int64], ways: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the first rigs, up to one whose period has other numbers of sub-steps."""
    first = ways[rigs[0]]
    count = 1
    while count < len(rigs):
        other = ways[rigs[count]]
        if other[0].steps != first[0].steps or other[1].steps != first[1].steps:
            break
        count += 1
    return rigs[:count]
