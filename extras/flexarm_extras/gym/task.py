"""Task of a policy: which arms, which set-points, how long, and what is good."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from flexarm_core.channels import BOUND_V, CHANNEL_NAMES, TRAVEL_V
from flexarm_core.errors import SettingError
from flexarm_daq.rigs.faulty import SENSOR_FAULTS, Fault
from flexarm_daq.rigs.rig_parameters import RigParameters

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np


@dataclass(frozen=True)
class SensorFault:
    """Fault of a sensor in an episode.

    Attributes
    ----------
    fault : Fault
        One of `flexarm_daq.rigs.faulty.SENSOR_FAULTS`, or its name.
    channel : str
        Sensor, one of `flexarm_core.channels.CHANNEL_NAMES`.
    after_samples : int
        Number of good samples before it.

    Raises
    ------
    SettingError
        When there is no such fault of a sensor, no such sensor, or a negative number of samples.
    """

    fault: Fault
    channel: str = CHANNEL_NAMES[0]
    after_samples: int = 0

    def __post_init__(self) -> None:
        names = [each.value for each in SENSOR_FAULTS]
        name = self.fault.value if isinstance(self.fault, Fault) else self.fault
        if name not in names:
            raise SettingError(f"fault must be one of {', '.join(names)}, got {name}")
        if self.channel not in CHANNEL_NAMES:
            raise SettingError(
                f"channel must be one of {', '.join(CHANNEL_NAMES)}, got {self.channel}"
            )
        if self.after_samples < 0:
            raise SettingError(f"after_samples must not be negative, got {self.after_samples}")
        object.__setattr__(self, "fault", Fault(name))


@dataclass(frozen=True)
class Task:
    """What a policy is asked: bring the position to a set-point, and the arm to rest there.

    The reward of a sample is minus a cost, of quantities without noise::

        (error / 3 V)^2 + strain_weight * (base strain / 1 V)^2 + effort_weight * (command / 10 V)^2

    An episode is truncated at its length, and terminated when the position leaves its bound. The
    samples that are left then count with the error at the bound, so that no policy gains by it.

    Attributes
    ----------
    rig : RigParameters
        Rig of every episode, but for its payload.
    payloads_kg : tuple of float
        Payloads; an episode draws one of them.
    set_points_v : tuple of float
        Least and largest set-point, V; an episode draws one in between.
    length_s, rate_hz : float
        Length of an episode, s, and its sampling rate, Hz.
    bound_v : float
        Largest magnitude of the position, V; the stops are at 6.86 V.
    strain_weight, effort_weight : float
        Weights of the reward.
    fault : SensorFault, optional
        Fault in every episode.

    Raises
    ------
    SettingError
        When a figure has no sense; the message names it.
    """

    rig: RigParameters = field(default_factory=RigParameters)
    payloads_kg: tuple[float, ...] = (0.0, 0.2, 0.4)
    set_points_v: tuple[float, float] = (-BOUND_V, BOUND_V)
    length_s: float = 10.0
    rate_hz: float = 300.0
    bound_v: float = 6.0
    strain_weight: float = 0.05
    effort_weight: float = 0.01
    fault: SensorFault | None = None

    def __post_init__(self) -> None:
        if not self.payloads_kg:
            raise SettingError("payloads_kg must hold at least one payload")
        for payload_kg in self.payloads_kg:
            replace(self.rig, payload_kg=payload_kg)
        for name in ("length_s", "rate_hz", "bound_v"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise SettingError(f"{name} must be positive, got {getattr(self, name)}")
        if self.bound_v > TRAVEL_V:
            raise SettingError(f"bound_v must be at most {TRAVEL_V:.2f} V, got {self.bound_v}")
        least_v, largest_v = self.set_points_v
        if not -self.bound_v < least_v <= largest_v < self.bound_v:
            raise SettingError(
                f"set_points_v must rise within bound_v = {self.bound_v} V, got {self.set_points_v}"
            )
        for name in ("strain_weight", "effort_weight"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise SettingError(f"{name} must not be negative, got {getattr(self, name)}")

    @property
    def samples(self) -> int:
        """Number of commands of an episode."""
        return max(1, round(self.length_s * self.rate_hz))


@dataclass(frozen=True)
class Episode:
    """What one episode has drawn: set-point, rig with its payload, seed of its noise, fault."""

    set_point_v: float
    rig: RigParameters
    seed: int
    fault: SensorFault | None


_OPTIONS = ("set_point_v", "payload_kg", "fault")


def draw_episode(
    task: Task, random: np.random.Generator, options: Mapping[str, Any] | None
) -> Episode:
    """Draw an episode of a task.

    Parameters
    ----------
    task : Task
        Task.
    random : numpy.random.Generator
        Source of chance; it is asked for the same numbers with and without options.
    options : mapping, optional
        What is not drawn: `set_point_v`, `payload_kg`, `fault` (a `SensorFault` or None).

    Returns
    -------
    Episode
        Episode.

    Raises
    ------
    SettingError
        When an option is not known or has no sense.
    """
    asked = dict(options or {})
    if unknown := sorted(set(asked) - set(_OPTIONS)):
        raise SettingError(f"option {unknown[0]} is not known: use {', '.join(_OPTIONS)}")
    payload_kg = task.payloads_kg[int(random.integers(len(task.payloads_kg)))]
    set_point_v = float(random.uniform(*task.set_points_v))
    seed = int(random.integers(2**31))
    set_point_v = float(asked.get("set_point_v", set_point_v))
    if not abs(set_point_v) < task.bound_v:
        raise SettingError(f"set_point_v must be within {task.bound_v} V, got {set_point_v}")
    rig = replace(task.rig, payload_kg=float(asked.get("payload_kg", payload_kg)))
    return Episode(set_point_v, rig, seed, asked.get("fault", task.fault))
