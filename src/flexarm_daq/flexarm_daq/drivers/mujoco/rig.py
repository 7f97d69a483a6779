"""Rig in MuJoCo, in virtual or in real time, and its bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flexarm_core.signals import RigSample, steps_to
from flexarm_daq.drivers.mujoco.arm import MujocoArm, engine
from flexarm_daq.rigs.late_readings import LateReadings
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from flexarm_core.arrays import FloatArray
    from flexarm_daq.drivers.mujoco.arm import MujocoSettings

_KINDS: Final = {
    "mjGEOM_SPHERE": "sphere",
    "mjGEOM_CAPSULE": "capsule",
    "mjGEOM_ELLIPSOID": "ellipsoid",
    "mjGEOM_CYLINDER": "cylinder",
    "mjGEOM_BOX": "box",
}
_PLANE: Final = "mjGEOM_PLANE"
_WIDE_M: Final = 2.0
_THIN_M: Final = 1e-3
"""Half width of a plane without bounds, and half thickness of any."""
_NO_COLOUR: Final = (0.5, 0.5, 0.5, 1.0)
"""Colour of a solid to which the model gives none; a single precision number is exact there."""
_SEEN_GROUPS: Final = 3
"""The engine's own viewer shows as many groups at first: those behind are for collisions."""


class MujocoRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` whose physics are those of MuJoCo [1]_.

    In virtual time, the default, sample k stands at k / rate, however long the caller takes, and a
    command acts from the last sample on: the same seed and commands give the same numbers. With a
    clock each call moves the arm on to the present, by whole steps of the engine, and at most by
    `flexarm_core.signals.MAX_CATCH_UP_S`.

    Parameters
    ----------
    settings : MujocoSettings
        Model, names and noise.
    folder : Path
        Where a relative model file begins.
    clock : callable, optional
        Monotonic time in seconds; without it, time is virtual.

    Attributes
    ----------
    settings : MujocoSettings
        As given.
    clock : callable or None
        As given; it may be set before the rig is opened.
    bodies : MujocoBodies
        What the arm is made of, to be drawn.

    References
    ----------
    .. [1] Todorov, E., Erez, T., Tassa, Y. (2012). MuJoCo: a physics engine for model-based
       control. IROS.
    """

    def __init__(
        self, settings: MujocoSettings, folder: Path, *, clock: Callable[[], float] | None = None
    ) -> None:
        self.settings = settings
        self._folder = folder
        self.clock = clock
        self._arm: MujocoArm | None = None
        self.bodies = MujocoBodies(lambda: self.arm)

    @property
    def has_virtual_time(self) -> bool:
        """Whether time stands still between the samples."""
        return self.clock is None

    @property
    def arm(self) -> MujocoArm:
        """The arm itself, without noise and cameras, while the rig is open."""
        if self._arm is None:
            raise RigError("the MuJoCo rig is not open: call open() first")
        return self._arm

    def open(self) -> None:
        """Start at the model's rest, at time zero, with the noise's seed; see `Rig.open`."""
        self._arm = MujocoArm(self.settings, self._folder)
        self._late = LateReadings(self.settings)
        self._is_fresh = True
        self._moved_s = self.clock() if self.clock is not None else 0.0

    def read(self) -> RigSample:
        """Sample the sensors with noise; see `Rig.read`."""
        arm = self.arm
        if self.clock is not None:
            self._follow(arm, self.clock())
        elif not self._is_fresh:
            arm.advance(arm.substeps)
        self._is_fresh = False
        return RigSample(arm.time_s, self._late(arm.time_s, arm.outputs()))

    def write(self, commands: Sequence[float]) -> None:
        """Command the actuators, which clip as the model says; see `Rig.write`."""
        arm = self.arm
        values = np.asarray(commands, dtype=float)
        if values.shape != (len(self.settings.actuators),) or not np.isfinite(values).all():
            raise RigError(
                f"commands must be {len(self.settings.actuators)} finite numbers, got {commands}"
            )
        if self.clock is not None:
            self._follow(arm, self.clock())
        arm.command(values)

    def safe_stop(self) -> None:
        """Set the actuators to zero; never raises."""
        if self._arm is not None:
            self._arm.command(np.zeros(len(self.settings.actuators)))

    def close(self) -> None:
        """Set the actuators to zero and close; `open` starts again from rest."""
        self.safe_stop()
        self._arm = None

    def _follow(self, arm: MujocoArm, now_s: float) -> None:
        """Move on to an instant of the clock; the rest of a long gap is left out."""
        steps, self._moved_s = steps_to(now_s, self._moved_s, arm.step_s)
        if steps:
            arm.advance(steps)


class MujocoBodies:
    """A `flexarm_daq.rigs.rig_protocol.Bodies` of a rig in MuJoCo.

    Parameters
    ----------
    arm : callable
        Returns the arm of the open rig.
    """

    def __init__(self, arm: Callable[[], MujocoArm]) -> None:
        self._arm = arm

    def solids(self) -> list[dict[str, Any]]:
        """Return the solids; in place of a mesh the box about it."""
        return list(self._solids())

    def poses(self) -> FloatArray:
        """Return the poses, (bodies, 7); the first body is the world."""
        data = self._arm().data
        return np.hstack((data.xpos, data.xquat))

    def _solids(self) -> Iterator[dict[str, Any]]:
        model, kinds = self._arm().model, engine().mjtGeom
        for number in range(model.ngeom):
            kind = kinds(model.geom_type[number]).name
            rgba = _colour(model, number)
            if rgba[3] == 0.0 or model.geom_group[number] >= _SEEN_GROUPS:
                continue
            place_m, turn = model.geom_pos[number], model.geom_quat[number]
            size_m = model.geom_size[number]
            if kind == _PLANE:
                size_m = np.array([*np.where(size_m[:2] > 0.0, size_m[:2], _WIDE_M), _THIN_M])
            elif kind not in _KINDS:
                centre_m, size_m = np.split(model.geom_aabb[number], 2)
                place_m = place_m + _turned(centre_m, turn)
            yield {
                "body": int(model.geom_bodyid[number]),
                "kind": _KINDS.get(kind, "box"),
                "size_m": size_m.tolist(),
                "place_m": place_m.tolist(),
                "turn": turn.tolist(),
                "rgba": rgba.tolist(),
            }


def _colour(model: Any, number: int) -> FloatArray:  # noqa: ANN401 - of the engine
    """Return red, green, blue and opacity of a solid, or those of its material."""
    rgba: FloatArray = model.geom_rgba[number]
    material = model.geom_matid[number]
    return model.mat_rgba[material] if material >= 0 and np.all(rgba == _NO_COLOUR) else rgba


def _turned(vector: FloatArray, turn: FloatArray) -> FloatArray:
    """Return a vector turned by a quaternion w, x, y, z."""
    w, axis = turn[0], turn[1:]
    twice = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + w * twice + np.cross(axis, twice))
