"""Bodies of an arm in MuJoCo: the solids that they are made of, and where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flexarm_daq.drivers.mujoco.arm import engine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_daq.drivers.mujoco.arm import MujocoArm

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
