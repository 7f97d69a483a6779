"""Schedules: a setting of the graph and a list of faults, both drawn from one seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from random import Random
from typing import TYPE_CHECKING, Final

from flexarm_control.laws.registry import LAWS
from flexarm_core.channels import CHANNEL_NAMES
from flexarm_daq.experiments.excitation import EXCITATIONS
from flexarm_daq.loop.limiter import LimiterSettings
from flexarm_daq.rigs.faulty import SENSOR_FAULTS, Fault

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

LENGTH_S: Final = 8.0
"""Virtual time of a schedule."""
QUIET_S: Final = 2.5
"""Time without a fault at its end: the graph is to be well again."""
# What the loop must do counts in periods: at a low rate a second of arm's time costs less.
_RATES_HZ: Final = (*(20.0,) * 4, *(50.0,) * 3, *(100.0,) * 3, 300.0)
# The laws are made for 300 Hz; far below that the arm is not stable.
_CONTROL_HZ: Final = 100.0
_LINKS: Final = (
    *("daq>controller", "controller>daq") * 2,
    *("daq>rival", "rival>daq"),
    *("daq>recorder", "controller>recorder", "rival>recorder"),
)
_LAWS: Final = tuple(name for name, row in LAWS.items() if row.rate_hz({}) is None)
_MOST_EVENTS: Final = 12


@dataclass(frozen=True, order=True)
class Event:
    """One fault, or one act of a user.

    Attributes
    ----------
    at_s : float
        Begin, s of virtual time.
    kind : str
        What happens: a key of `simulation.ACTS`.
    target : str
        Link, process, sensor, limit or law that it concerns.
    value : float
        Its size, in the unit of its kind.
    length_s : float
        Its duration, s.
    """

    at_s: float
    kind: str
    target: str = ""
    value: float = 0.0
    length_s: float = 0.0

    def __str__(self) -> str:
        text = f"{self.at_s:8.4f} s  {self.kind:<10}"
        text += f" {self.target}" * bool(self.target)
        text += f" {self.value:.6g}" * bool(self.value)
        return text + f" for {self.length_s:.4f} s" * bool(self.length_s)


@dataclass(frozen=True)
class Schedule:
    """A setting and its events; the same schedule gives the same run to the bit.

    `time` is that of the loop: real, paced (by the rig), or virtual. `commander` is the one that
    answers from the start: a law or a waveform.
    """

    seed: int
    rate_hz: float
    time: str
    commander: str
    limits: LimiterSettings
    max_age_periods: int
    events: tuple[Event, ...]
    answer_timeout_s: float = 0.5

    def of(self, events: tuple[Event, ...]) -> Schedule:
        """Return the same setting with other events."""
        return replace(self, events=events)

    def __str__(self) -> str:
        head = (
            f"seed {self.seed}: {self.commander} at {self.rate_hz:g} Hz in {self.time} time, "
            f"{self.limits}, a command is in force for {self.max_age_periods} periods"
        )
        return "\n".join([head, *(f"  {event}" for event in self.events)])


def draw(seed: int) -> Schedule:
    """Return the schedule of a seed."""
    random = Random(seed)  # noqa: S311 - not for secrets
    events = [_event(random) for _ in range(random.randint(1, _MOST_EVENTS))]
    rate_hz = random.choice(_RATES_HZ)
    return Schedule(
        seed,
        rate_hz,
        random.choice(("real", "real", "paced", "virtual")),
        random.choice((*_LAWS, *EXCITATIONS) if rate_hz >= _CONTROL_HZ else tuple(EXCITATIONS)),
        _limits(random),
        random.choice((3, 3, 3, 1, 2, 6)),
        tuple(sorted(events)),
    )


def _limits(random: Random) -> LimiterSettings:
    return LimiterSettings(
        max_command_v=random.choice((10.0, 10.0, 4.0, 1.0)),
        max_slew_v_per_s=random.choice((6000.0, 6000.0, 300.0, 60.0)),
        position_bound_v=random.choice((6.5, 6.5, 2.0)),
    )


def _event(random: Random) -> Event:
    kind = random.choice(tuple(_DRAWN))
    target, value, length_s = _DRAWN[kind](random)
    latest_s = LENGTH_S - QUIET_S - length_s
    return Event(round(random.uniform(0.1, latest_s), 4), kind, target, value, length_s)


def _length_s(random: Random) -> float:
    """Return a duration from a millisecond to two seconds, short ones as often as long ones."""
    return round(math.exp(random.uniform(math.log(1e-3), math.log(2.0))), 4)


def _link(value: Callable[[Random], float]) -> Callable[[Random], tuple[str, float, float]]:
    return lambda random: (random.choice(_LINKS), round(value(random), 5), _length_s(random))


def _late_s(random: Random) -> float:
    return math.exp(random.uniform(math.log(5e-4), math.log(0.2)))


def _sensor(random: Random) -> tuple[str, float, float]:
    fault = random.choice(tuple(Fault))
    channel = random.choice(CHANNEL_NAMES) if fault in SENSOR_FAULTS else CHANNEL_NAMES[0]
    return f"{fault.value} {channel}", 0.0, 0.0


def _kill(random: Random) -> tuple[str, float, float]:
    """Draw a process that is killed, for a recorder at once or in the middle of a write."""
    process = random.choice(_PROCESSES)
    share = random.choice((0.0, round(random.uniform(0.01, 0.99), 3)))
    return process, share if process == "recorder" else 0.0, _length_s(random)


def _limit(random: Random) -> tuple[str, float, float]:
    name = random.choice(tuple(vars(LimiterSettings())))
    values = {
        "max_command_v": (0.5, 2.0, 10.0),
        "max_slew_v_per_s": (30.0, 500.0, 6000.0),
        "position_bound_v": (1.0, 3.0, 6.5),
    }
    return name, random.choice(values[name]), 0.0


_PROCESSES: Final = ("daq", "controller", "controller", "rival", "recorder", "recorder")
_DRAWN: Final[Mapping[str, Callable[[Random], tuple[str, float, float]]]] = {
    "delay": _link(_late_s),
    "reorder": _link(_late_s),
    "duplicate": _link(_late_s),
    "drop": _link(lambda random: random.choice((1.0, 0.5, 0.1))),
    "stall": lambda random: (random.choice(_PROCESSES), 0.0, _length_s(random)),
    "kill": _kill,
    "deactivate": lambda random: ("daq", 0.0, _length_s(random)),
    "emergency": lambda _: ("daq", 0.0, 0.0),
    "limit": _limit,
    "law": lambda random: (random.choice(_LAWS), 0.0, 0.0),
    "rival": lambda random: (
        random.choice(tuple(EXCITATIONS)),
        random.choice((0.0, float(random.randint(-300, 300)))),
        _length_s(random),
    ),
    "sensor": _sensor,
    "record": lambda random: ("recorder", 0.0, _length_s(random)),
    "backlog": lambda random: (
        "recorder",
        round(random.uniform(0.02, 0.3), 3),
        round(random.uniform(0.3, 1.5), 3),
    ),
    "repeat": lambda random: (
        random.choice(("controller", "controller", "rival")),
        random.choice((0.0, round(random.uniform(0.05, 0.5), 3))),
        round(random.uniform(0.3, 2.5), 3),
    ),
    "disk": lambda random: ("recorder", float(random.randint(0, 40_000)), _length_s(random)),
    "wall": lambda random: (
        "",
        round(random.choice((-1.0, 1.0)) * math.exp(random.uniform(math.log(1e-3), 16.0)), 4),
        0.0,
    ),
}
"""How target, value and length of each kind of event are drawn."""
