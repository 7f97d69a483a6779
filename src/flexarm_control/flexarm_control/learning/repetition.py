"""Learning of a command by repetition: the differences of a run improve the command of the next.

The loop that follows a trajectory turns a change of the played command f into changes of position
and middle gauge, T1 f and T3 f. Of a run with differences e1 and e3 the change that would have
lessened |e1|^2 + w |e3|^2 most is, frequency by frequency [1]_::

    f = (T1* e1 + w T3* e3) / (|T1|^2 + w |T3|^2)

T1 and T3 are those of the flat model with the gains of the loop. Above the cutoff, where this
model ends, nothing is learned: a low-pass without a phase takes it. Without the gauge (w = 0) the
arm, clamped by friction, swings more with every repetition.

References
----------
.. [1] Bristow, D. A., Tharayil, M., and Alleyne, A. G. (2006). A survey of iterative learning
   control. IEEE Control Systems Magazine 26(3), 96-114.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.learning.trajectory import command_weights, output_weights
from flexarm_control.models.arm_model import MIDDLE_STRAIN, POSITION
from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.errors import SettingError
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_control.laws.gains import PdpGains
    from flexarm_control.learning.trajectory import Trajectory
    from flexarm_control.planning.flat_arm import FlatArm
    from flexarm_core.arrays import ComplexArray, FloatArray

_STEEPNESS = 8
_LAST_SAMPLES = 100
_PATIENCE = 3
"""Repetitions without a new best one that end the learning."""


@dataclass(frozen=True)
class LearningSettings(Bounded):
    """Share of a change that is taken, weight of the gauge, and cutoff of what is learned."""

    share: float = setting(0.7, 0.05, 1.5, "", "part of the computed change that is taken")
    strain_weight: float = setting(0.3, 0.0, 10.0, "", "weight of the middle gauge, squared")
    cutoff_hz: float = setting(8.0, 0.5, 50.0, "Hz", "nothing is learned above")


class LoopResponse(NamedTuple):
    """Responses of position and middle gauge to a played command, (frequencies,)."""

    position: ComplexArray
    middle_strain: ComplexArray


class Repetition(NamedTuple):
    """What a run has played, and its differences to the trajectory.

    Attributes
    ----------
    played : Trajectory
        Trajectory and command.
    position_rms_v, strain_rms_v : float
        Root mean squares of the differences of position and middle gauge, V.
    weighted_v : float
        Root of the sum of their squares, that of the gauge weighted: what the learning lessens.
    """

    played: Trajectory
    position_rms_v: float
    strain_rms_v: float
    weighted_v: float


def loop_response(
    arm: FlatArm, gains: PdpGains, frequency_hz: FloatArray, *, delay_s: float
) -> LoopResponse:
    """Return the responses of a PDP loop around the flat model to a command that is added.

    Parameters
    ----------
    arm : FlatArm
        Figures of the arm.
    gains : PdpGains
        Gains of the loop (4-7).
    frequency_hz : ndarray
        Frequencies, Hz.
    delay_s : float
        Time from a sample to its command, with half a period for the hold, s.
    """
    powers = (2j * pi * frequency_hz) ** np.arange(5)[:, np.newaxis]
    position, middle_strain, speed = output_weights(arm) @ powers[:-1]
    command = command_weights(arm) @ powers[1:]
    delay = np.exp(-2j * pi * frequency_hz * delay_s)
    fed_back = gains.kp * position + gains.kd * speed + gains.ksg * middle_strain
    closed = delay / (command + delay * fed_back)
    return LoopResponse(position * closed, middle_strain * closed)


def repetition(
    played: Trajectory, y: FloatArray, settings: LearningSettings | None = None
) -> Repetition:
    """Return a run with its differences.

    Parameters
    ----------
    played : Trajectory
        What was played.
    y : ndarray, (samples, 4)
        Outputs, V.
    settings : LearningSettings, optional
        Settings, for the weight of the gauge.

    Raises
    ------
    SettingError
        When the outputs are fewer than the samples of the trajectory, or not finite.
    """
    weight = (settings or LearningSettings()).strain_weight
    position_v, strain_v = (_rms(each) for each in _differences(played, y))
    weighted_v = float(np.hypot(position_v, np.sqrt(weight) * strain_v))
    return Repetition(played, position_v, strain_v, weighted_v)


def improved(
    played: Trajectory,
    y: FloatArray,
    arm: FlatArm,
    gains: PdpGains,
    *,
    delay_s: float,
    settings: LearningSettings | None = None,
) -> Trajectory:
    """Return a trajectory with the command improved by the differences of a run.

    Parameters
    ----------
    played, y
        As for `repetition`.
    arm, gains, delay_s
        As for `loop_response`.
    settings : LearningSettings, optional
        Settings.

    Raises
    ------
    SettingError
        As of `repetition`.
    """
    settings = settings or LearningSettings()
    position_v, strain_v = _differences(played, y)
    samples = len(played)
    frequency_hz = np.linspace(0.0, 0.5 * played.rate_hz, samples + 1)
    response = loop_response(arm, gains, frequency_hz, delay_s=delay_s)
    # A transform repeats itself: the second half leads from the end back to the beginning.
    left_v = position_v[-_LAST_SAMPLES:].mean() * np.linspace(1.0, 0.0, samples)
    position = np.fft.rfft(np.concatenate([position_v, left_v]))
    strain = np.fft.rfft(strain_v, 2 * samples)
    weight = settings.strain_weight
    gained = response.position.conj() * position + weight * response.middle_strain.conj() * strain
    size = np.abs(response.position) ** 2 + weight * np.abs(response.middle_strain) ** 2
    command = np.fft.rfft(played.command_v, 2 * samples) + settings.share * gained / size
    passed = 1.0 / (1.0 + (frequency_hz / settings.cutoff_hz) ** _STEEPNESS)
    command_v = np.fft.irfft(passed * command)[:samples]
    return played.playing(np.clip(command_v, -MAX_COMMAND_V, MAX_COMMAND_V))


def without_model(trajectory: Trajectory, gains: PdpGains) -> Trajectory:
    """Return a trajectory whose command leaves the loop nothing but the position to follow.

    It takes away what the loop would send for the speed and the gauge that are asked for.
    """
    of_speed_v = gains.kd * trajectory.speed_v
    return trajectory.playing(-of_speed_v - gains.ksg * trajectory.middle_strain_v)


def learned(
    run: Callable[[int, Trajectory], FloatArray],
    first: Trajectory,
    improve: Callable[[Trajectory, FloatArray], Trajectory],
    *,
    repetitions: int,
    settings: LearningSettings | None = None,
) -> list[Repetition]:
    """Run a trajectory, and again with its command improved, until nothing is gained any more.

    Parameters
    ----------
    run : callable
        Function that plays a trajectory from rest and returns the outputs, V, (samples, 4); it gets
        the number of the repetition too.
    first : Trajectory
        What repetition 0 plays.
    improve : callable
        Function from what was played and its outputs to what is played next: `improved`, with
        an arm.
    repetitions : int
        Most repetitions after the first run.
    settings : LearningSettings, optional
        Settings, for the weight of the gauge.

    Returns
    -------
    list of Repetition
        All runs in their order; `best` says which one to keep.
    """
    done: list[Repetition] = []
    played = first
    while len(done) <= repetitions and not (done and is_over(done)):
        y = run(len(done), played)
        done.append(repetition(played, y, settings))
        played = improve(played, y)
    return done


def best(repetitions: Sequence[Repetition]) -> int:
    """Return the number of the repetition with the least differences, position and gauge weighted.

    Its position is no farther from the trajectory than that of the first.
    """
    first_v = repetitions[0].position_rms_v
    good = [at for at, each in enumerate(repetitions) if each.position_rms_v <= first_v]
    return min(good, key=lambda at: repetitions[at].weighted_v)


def is_over(repetitions: Sequence[Repetition]) -> bool:
    """Return whether the last three repetitions have brought no better one."""
    return len(repetitions) - 1 - best(repetitions) >= _PATIENCE


def _differences(played: Trajectory, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    samples = len(played)
    if len(y) < samples or not np.isfinite(y).all():
        raise SettingError(
            f"a run of {samples} samples is needed to learn from, all of them finite; got {len(y)}"
        )
    position_v: FloatArray = played.position_v - y[:samples, POSITION]
    strain_v: FloatArray = played.middle_strain_v - y[:samples, MIDDLE_STRAIN]
    return position_v, strain_v


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
