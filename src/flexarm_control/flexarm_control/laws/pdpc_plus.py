"""PDPC law without gear hitting and lasting oscillation at rest (chapter 5, future work 2).

Two effects keep an arm under PDPC from resting. The noise of the tachometer passes the speed
threshold of (4-8) now and then, and each time the compensation moves the motor. A motor that its
friction holds is a clamp, against which the arm oscillates for seconds.

Here the set-point counts as reached by filtered signals and with a hysteresis. From then on the
motor yields to the arm. The base gauge shows the bent arm, and a compensation below the friction
helps it to turn the motor. The motor turns only while the arm pushes it, and friction takes the
energy. The help goes to zero as the arm comes to rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isfinite, pi
from typing import TYPE_CHECKING

from flexarm_control.laws.gains import CompensationLevel, PdpGains
from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, limited
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.law_protocol import Memory


@dataclass(frozen=True)
class RestThresholds(Bounded):
    """Thresholds of the rest at the set-point, and the help to the bent arm.

    The set-point is reached when the filtered position error and speed are both below their
    thresholds. It is left when one of them exceeds its threshold by its hysteresis. A threshold
    should be a few times the noise of its filtered signal. The help must be less than the friction,
    or it turns the motor alone.
    """

    rest_error_v: float = setting(0.005, 0.001, 1.0, "V", "position error below which it rests")
    error_hysteresis_v: float = setting(0.02, 0.0, 1.0, "V", "additional error that ends the rest")
    rest_speed_v: float = setting(0.05, 0.001, 1.0, "V", "speed signal below which the arm rests")
    speed_hysteresis_v: float = setting(0.03, 0.0, 1.0, "V", "additional speed that ends the rest")
    error_bandwidth_hz: float = setting(15.0, 0.5, 1000.0, "Hz", "low-pass of error and speed")
    strain_bandwidth_hz: float = setting(5.0, 0.5, 1000.0, "Hz", "low-pass of the base strain")
    release_v: float = setting(0.55, 0.0, 2.0, "V", "largest help to the bent arm at rest")
    release_strain_v: float = setting(0.05, 0.001, 5.0, "V", "base strain of the full help")


@dataclass(frozen=True)
class Rest(RestThresholds):
    """Thresholds of the rest with the sampling rate of the law."""

    rate_hz: float = setting(300.0, 50.0, 2000.0, "Hz", "sampling rate of the signals")


class CalmRest:
    """State of the rest, one sample at a time.

    Parameters
    ----------
    thresholds : RestThresholds
        Thresholds of the rest, and the help to the bent arm.
    rate_hz : float
        Sampling rate of the signals, Hz.

    Attributes
    ----------
    resting : bool
        Whether the set-point counts as reached.
    """

    def __init__(self, thresholds: RestThresholds, rate_hz: float) -> None:
        self._thresholds = thresholds
        self._error_share = _share(thresholds.error_bandwidth_hz, rate_hz)
        self._strain_share = _share(thresholds.strain_bandwidth_hz, rate_hz)
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._error_v = self._speed_v = self._strain_v = 0.0
        self._started = self.resting = False

    def step(self, error_v: float, strain_v: float, speed_v: float) -> float:
        """Take a sample, and return the help to the bent arm, V: zero when there is no rest.

        Parameters
        ----------
        error_v, strain_v, speed_v : float
            Error of the position, base strain and speed, V, all finite.
        """
        rest = self._thresholds
        if not self._started:
            self._error_v, self._started = error_v, True
        # The sums are weighted, since a difference of finite numbers may overflow.
        share = self._error_share
        self._error_v = (1.0 - share) * self._error_v + share * error_v
        self._speed_v = (1.0 - share) * self._speed_v + share * speed_v
        share = self._strain_share
        self._strain_v = (1.0 - share) * self._strain_v + share * strain_v
        error_limit_v, speed_limit_v = rest.rest_error_v, rest.rest_speed_v
        if self.resting:
            error_limit_v += rest.error_hysteresis_v
            speed_limit_v += rest.speed_hysteresis_v
        self.resting = abs(self._error_v) < error_limit_v and abs(self._speed_v) < speed_limit_v
        if not self.resting:
            return 0.0
        return -rest.release_v * min(1.0, max(-1.0, self._strain_v / rest.release_strain_v))

    def memory(self) -> Memory:
        """Return the filtered signals and the rest; see `LawWithMemory.memory`."""
        return {
            "filtered_v": (self._error_v, self._speed_v, self._strain_v),
            "started": (float(self._started),),
            "resting": (float(self.resting),),
        }

    def remember(self, memory: Memory) -> None:
        """Go on from filtered signals and a rest; see `LawWithMemory.remember`."""
        self._error_v, self._speed_v, self._strain_v = memory["filtered_v"]
        self._started, self.resting = bool(memory["started"][0]), bool(memory["resting"][0])


class PdpcPlus:
    """PDPC law without oscillation at rest.

    Parameters
    ----------
    gains : PdpGains, optional
        Gains of the PDP law (4-7).
    level : CompensationLevel, optional
        Level of the Coulomb friction compensation during a move.
    rest : Rest, optional
        Thresholds of the rest, and the help to the bent arm.
    """

    def __init__(
        self,
        gains: PdpGains | None = None,
        level: CompensationLevel | None = None,
        rest: Rest | None = None,
    ) -> None:
        self._gains = gains if gains is not None else PdpGains()
        self._level = level if level is not None else CompensationLevel()
        rest = rest if rest is not None else Rest()
        self._rest = CalmRest(rest, rest.rate_hz)
        # All of its state.
        self.reset, self.memory = self._rest.reset, self._rest.memory
        self.remember = self._rest.remember

    @property
    def resting(self) -> bool:
        """Whether the set-point counts as reached."""
        return self._rest.resting

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        error_v, strain_v, speed_v = reference_v - volts[0], volts[1], volts[3]
        effort_v = self._gains.effort_v(error_v, volts)
        if not (isfinite(effort_v) and isfinite(strain_v) and isfinite(error_v + speed_v)):
            return NO_EFFORT
        help_v = self._rest.step(error_v, strain_v, speed_v)
        if self._rest.resting:
            return limited(effort_v, help_v)
        return limited(effort_v, self._level.command_v(effort_v, error_v, speed_v))


def _share(bandwidth_hz: float, rate_hz: float) -> float:
    """Return the share of a new sample in a first-order low-pass."""
    return 1.0 - exp(-2.0 * pi * bandwidth_hz / rate_hz)
