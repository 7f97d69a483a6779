"""Newest readings of a robot, with what is missing, stale or out of order by name."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from threading import Condition
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flexarm_core.errors import SettingError, nearest
from flexarm_daq.rigs.rig_protocol import RigError, RigSample

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

JOINT_KINDS: Final = ("position", "velocity", "effort")
_AXES: Final = ("x", "y", "z")
FIELDS: Final[dict[str, tuple[str, ...]]] = {
    "imu": tuple(
        f"{of}.{axis}" for of in ("angular_velocity", "linear_acceleration") for axis in _AXES
    ),
    "wrench": tuple(f"{of}.{axis}" for of in ("force", "torque") for axis in _AXES),
    "float": ("data",),
}
"""Fields of the messages beside the joint states."""
_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_OF_TOPIC = re.compile(r"(imu|wrench|float):([^:]+)(?::([^:]+))?")


class Source(NamedTuple):
    """Where an output comes from.

    Attributes
    ----------
    kind : str
        One of `JOINT_KINDS` or of `FIELDS`.
    name : str
        Joint or topic.
    field : str
        Field of the message of a topic; empty for a joint.
    """

    kind: str
    name: str
    field: str = ""


@dataclass(frozen=True)
class TopicsSettings:
    """Settings of the driver `topics`.

    Attributes
    ----------
    commands : str
        Topic of type Float64MultiArray that takes a number for each input, such as
        ``/effort_controller/commands``.
    outputs : tuple of str
        Source of each output: ``position:JOINT``, ``velocity:JOINT``, ``effort:JOINT``,
        ``imu:TOPIC:angular_velocity.z`` or another field, ``wrench:TOPIC:force.x`` or another
        field, or ``float:TOPIC``.
    joint_states : str
        Topic of the joint states, whose messages are the samples.
    stale_s : float
        Age of a reading, or wait for a sample, that ends the run.

    Raises
    ------
    SettingError
        If an output is none of that, none of them is of a joint, a topic has no name of one, or the
        age is not positive.
    """

    commands: str
    outputs: tuple[str, ...]
    joint_states: str = "/joint_states"
    stale_s: float = 0.1

    def __post_init__(self) -> None:
        if not self.stale_s > 0.0:
            raise SettingError(f"settings.stale_s = {self.stale_s:g} must be positive")
        if not any(each.kind in JOINT_KINDS for each in self.sources):
            raise SettingError(
                "settings.outputs has no joint: the joint states are the samples of the rig, so "
                "that one output is position:JOINT, velocity:JOINT or effort:JOINT"
            )
        topics = {each.name: "outputs" for each in self.sources if each.kind in FIELDS}
        topics |= {self.commands: "commands", self.joint_states: "joint_states"}
        for topic, setting in topics.items():
            if not _TOPIC.fullmatch(topic):
                raise SettingError(
                    f"settings.{setting}: {topic!r} is not the name of a topic: write letters, "
                    "digits and _ between slashes, such as /effort_controller/commands"
                )

    @property
    def sources(self) -> tuple[Source, ...]:
        """The outputs, read."""
        return tuple(_source(each) for each in self.outputs)


def _source(text: str) -> Source:
    kind, _, name = text.partition(":")
    if kind in JOINT_KINDS and name:
        return Source(kind, name)
    found = _OF_TOPIC.fullmatch(text)
    if found is None:
        raise SettingError(
            f"settings.outputs: {text!r} is not a source{nearest(kind, (*JOINT_KINDS, *FIELDS))}: "
            "write such as position:JOINT or imu:TOPIC:angular_velocity.z"
        )
    field = found[3] or FIELDS[kind][0]
    if field not in FIELDS[kind] or (found[3] is None and len(FIELDS[kind]) > 1):
        raise SettingError(
            f"settings.outputs: {text!r} has no field{nearest(found[3] or '', FIELDS[kind])}: name "
            f"one of {', '.join(FIELDS[kind])}"
        )
    return Source(kind, found[2], field)


class Inbox:
    """Readings as they come from another thread, and samples of them.

    Parameters
    ----------
    settings : TopicsSettings
        Sources of the outputs.
    """

    def __init__(self, settings: TopicsSettings) -> None:
        self._settings = settings
        self._sources = settings.sources
        self._come = Condition()
        self._newest: dict[Source, tuple[float, float]] = {}
        self._stamp_s: float | None = None
        self._first_s: float | None = None
        self._count = self._taken = 0
        self._complaint = ""

    def joints(
        self, stamp_s: float, names: Sequence[str], values: Mapping[str, Sequence[float]]
    ) -> None:
        """Take joint states: their instant, and the values of each of `JOINT_KINDS`.

        States that lack a joint are another broadcaster's, and left out.
        """
        with self._come:
            self._complaint = self._lacking(names, values)
            if not self._complaint and self._stamp_s is not None and stamp_s <= self._stamp_s:
                self._complaint = (
                    f"their stamps do not go on: {stamp_s:.6f} s after {self._stamp_s:.6f} s"
                )
            if self._complaint:
                return
            now_s = time.monotonic()
            for source in self._sources:
                if source.kind in JOINT_KINDS:
                    value = values[source.kind][list(names).index(source.name)]
                    self._newest[source] = now_s, float(value)
            self._first_s = stamp_s if self._first_s is None else self._first_s
            self._stamp_s = stamp_s
            self._count += 1
            self._come.notify_all()

    def reading(self, kind: str, topic: str, values: Mapping[str, float]) -> None:
        """Take a message of another topic, by its fields."""
        with self._come:
            now_s = time.monotonic()
            for source in self._sources:
                if (source.kind, source.name) == (kind, topic):
                    self._newest[source] = now_s, float(values[source.field])
            self._come.notify_all()

    def sample(self, patience_s: float) -> RigSample:
        """Wait for joint states that were not taken yet; of several take the newest.

        Raises
        ------
        RigError
            If none come in time, they lack a joint, or another reading is stale.
        """
        with self._come:
            if not self._come.wait_for(self._is_whole, patience_s):
                raise RigError(self._missing(patience_s))
            self._taken = self._count
            now_s = time.monotonic()
            for source in self._sources:
                age_s = now_s - self._newest[source][0]
                if age_s > self._settings.stale_s:
                    raise RigError(
                        f"the newest reading of {source.name} is {age_s:.3f} s old, for stale_s = "
                        f"{self._settings.stale_s:g}: check its publisher"
                    )
            assert self._stamp_s is not None  # noqa: S101 - a sample was counted
            assert self._first_s is not None  # noqa: S101
            readings = np.array([self._newest[source][1] for source in self._sources])
            return RigSample(self._stamp_s - self._first_s, readings)

    def _is_whole(self) -> bool:
        return self._count > self._taken and len(self._newest) == len(set(self._sources))

    def _missing(self, patience_s: float) -> str:
        settings = self._settings
        if self._complaint:
            return (
                f"no sample of {settings.joint_states} within {patience_s:g} s: {self._complaint}"
            )
        if self._count == self._taken:
            return (
                f"no joint states on {settings.joint_states} within {patience_s:g} s: is the "
                "robot's joint_state_broadcaster active, in this ROS_DOMAIN_ID?"
            )
        silent = sorted({each.name for each in self._sources if each not in self._newest})
        return f"nothing came on {', '.join(silent)} within {patience_s:g} s: is it published?"

    def _lacking(self, names: Sequence[str], values: Mapping[str, Sequence[float]]) -> str:
        for source in self._sources:
            if source.kind not in JOINT_KINDS:
                continue
            if source.name not in names:
                return (
                    f"they lack the joint {source.name}{nearest(source.name, names)}: they have "
                    f"{', '.join(names)}"
                )
            if len(values[source.kind]) != len(names):
                return f"they have no {source.kind}, which an output needs"
        return ""
