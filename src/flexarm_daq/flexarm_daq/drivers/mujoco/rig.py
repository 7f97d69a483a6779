"""Rig in MuJoCo: actuators and sensors by name, whole steps, bodies, virtual or real time."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from importlib import import_module
from importlib.resources import as_file, files
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flexarm_core.errors import SettingError, nearest, one_line
from flexarm_core.signals import RigSample, steps_to
from flexarm_daq.rigs.late_readings import LateReadings, SensorSettings, require_from_zero
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from flexarm_core.arrays import FloatArray

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
_FRAME_S: Final = 1.0 / 60.0
_DISPLAYS: Final = ("DISPLAY", "WAYLAND_DISPLAY")
INSTALL: Final = f'{sys.executable} -m pip install "mujoco>=3.3,<5"'
"""Command that installs the engine."""
_ENTRY = re.compile(r"(.+)\[(\d+)\]")


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
        arm = MujocoArm(self.settings, self._folder)
        self._shown = Viewer(arm) if self.settings.viewer else None
        self._arm = arm
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
        if self._shown is not None:
            self._shown.follow()
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
        if self._arm is not None and self._shown is not None:
            self._shown.close()
        self._arm = None

    def _follow(self, arm: MujocoArm, now_s: float) -> None:
        """Move on to an instant of the clock; the rest of a long gap is left out."""
        steps, self._moved_s = steps_to(now_s, self._moved_s, arm.step_s)
        if steps:
            arm.advance(steps)


class Viewer:
    """The engine's own viewer of an arm; the arm goes on when its window is closed.

    Parameters
    ----------
    arm : MujocoArm
        The arm.

    Raises
    ------
    RigError
        If there is no display.
    """

    def __init__(self, arm: MujocoArm) -> None:
        if sys.platform.startswith("linux") and not any(map(os.environ.get, _DISPLAYS)):
            raise RigError(
                "the viewer needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set: leave "
                "the viewer out, the live page shows the bodies too"
            )
        self._arm = arm
        self._window = import_module("mujoco.viewer").launch_passive(
            arm.model, arm.data, show_left_ui=False, show_right_ui=False
        )
        self._next_s = 0.0

    def follow(self) -> None:
        """Show the present state, at most 60 times a second of the arm."""
        if self._arm.time_s >= self._next_s and self._window.is_running():
            self._next_s = self._arm.time_s + _FRAME_S
            self._window.sync()

    def close(self) -> None:
        """Close the window."""
        self._window.close()


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


@dataclass(frozen=True, kw_only=True)
class MujocoSettings(SensorSettings):
    """Settings of the driver `mujoco`.

    A sensor is named ``NAME[INDEX]`` for an entry of one with several, or ``jointpos:JOINT`` or
    ``jointvel:JOINT``. The mass of the payload is added to a body, at its centre of mass.

    Attributes
    ----------
    model : str
        MJCF or URDF file, a relative one beside the description; or ``thesis_arm`` or ``two_link``.
    actuators : tuple of str
        Actuator of each input, or ``motor:JOINT`` for a torque at a joint that has none.
    substeps : int
        Steps of the engine in a period; 0 for as many as the model's own time step needs.
    payload_body : str
        Body that carries the payload.
    viewer : bool
        Whether the engine's own viewer shows the arm.

    Raises
    ------
    SettingError
        If a number is out of range, or a list has not one for every output.
    """

    model: str
    actuators: tuple[str, ...]
    substeps: int = 0
    payload_body: str = ""
    viewer: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        require_from_zero(self, "substeps")
        if self.payload_kg and not self.payload_body:
            raise SettingError("settings.payload_kg needs settings.payload_body, which carries it")


class MujocoArm:
    """State of an arm in MuJoCo, at rest at time zero.

    Parameters
    ----------
    settings : MujocoSettings
        Model and names.
    folder : Path
        Where a relative model file begins.

    Attributes
    ----------
    model, data : mujoco.MjModel, mujoco.MjData
        The engine's own view.
    step_s : float
        Time step, a whole part of the period, s.

    Raises
    ------
    RigError
        If MuJoCo is not installed.
    SettingError
        If there is no such model, or it lacks a name.
    """

    def __init__(self, settings: MujocoSettings, folder: Path) -> None:
        self._mujoco = engine()
        # By default a file in the working folder gets them; `advance` reports what diverges.
        self._mujoco.set_mju_user_warning(lambda _: None)
        self.model = self._compiled(settings, folder)
        self.substeps = settings.substeps or max(
            1, round(1.0 / (settings.rate_hz * self.model.opt.timestep))
        )
        self.step_s = 1.0 / (settings.rate_hz * self.substeps)
        self.model.opt.timestep = self.step_s
        # By default the engine begins anew at rest, in silence, when a state is not a number.
        self.model.opt.disableflags |= self._mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.data = self._mujoco.MjData(self.model)
        if settings.payload_body:
            self._load(settings.payload_body, settings.payload_kg)
        self._inputs = [
            self._number("ACTUATOR", name.replace(":", "_"), "actuators", name)
            for name in settings.actuators
        ]
        self._outputs = [self._address(name) for name in settings.sensors]
        self._steps = 0

    @property
    def time_s(self) -> float:
        """Time of the state, s."""
        return self._steps * self.step_s

    def command(self, commands: FloatArray) -> None:
        """Set the actuators, (inputs,), in their units, from the present step on."""
        self.data.ctrl[self._inputs] = commands

    def advance(self, steps: int) -> None:
        """Move on by a number of steps.

        Raises
        ------
        RigError
            If a state is not a finite number.
        """
        self._mujoco.mj_step(self.model, self.data, steps)
        self._steps += steps
        if not (np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all()):
            raise RigError(
                f"the model diverged before {self.time_s:.3f} s with steps of {self.step_s:.2g} s: "
                "set more substeps"
            )

    def outputs(self) -> FloatArray:
        """Return the sensors of the present state, (outputs,), in their units."""
        # After a step, the sensors are still those of the state before it.
        self._mujoco.mj_forward(self.model, self.data)
        readings: FloatArray = self.data.sensordata[self._outputs]
        return readings

    def _compiled(self, settings: MujocoSettings, folder: Path) -> Any:  # noqa: ANN401 - of the engine
        try:
            spec = self._spec(settings.model, folder)
            _add_motors(spec, settings.actuators)
            _add_joint_sensors(self._mujoco, spec, settings.sensors)
            return spec.compile()
        except (ValueError, self._mujoco.FatalError) as error:
            raise SettingError(f"settings.model = {settings.model}: {one_line(error)}") from None

    def _spec(self, model: str, folder: Path) -> Any:  # noqa: ANN401 - of the engine
        packaged = files(__package__).joinpath(f"{model}.xml")
        if packaged.is_file():
            with as_file(packaged) as file:
                return self._mujoco.MjSpec.from_file(str(file))
        file = folder / model
        if not file.is_file():
            raise SettingError(
                f"settings.model = {model}: there is no file {file}, and no packaged model of that "
                "name: thesis_arm, two_link"
            )
        return self._mujoco.MjSpec.from_file(str(file))

    def _load(self, body: str, payload_kg: float) -> None:
        number = self._number("BODY", body, "payload_body", body)
        self.model.body_mass[number] += payload_kg
        self._mujoco.mj_setConst(self.model, self._mujoco.MjData(self.model))

    def _address(self, name: str) -> int:
        found = _ENTRY.fullmatch(name)
        base, index = (found[1], int(found[2])) if found else (name, 0)
        number = self._number("SENSOR", base.replace(":", "_"), "sensors", name)
        entries = int(self.model.sensor_dim[number])
        if not (index < entries and (found or entries == 1)):
            raise SettingError(
                f"settings.sensors: {base} has {entries} entries: name one, {base}[0] to "
                f"{base}[{entries - 1}]"
            )
        return int(self.model.sensor_adr[number]) + index

    def _number(self, kind: str, name: str, setting: str, said: str) -> int:
        number = self._mujoco.mj_name2id(
            self.model, getattr(self._mujoco.mjtObj, f"mjOBJ_{kind}"), name
        )
        if number < 0:
            count = getattr(self.model, {"ACTUATOR": "nu", "SENSOR": "nsensor"}.get(kind, "nbody"))
            lookup = getattr(self.model, kind.lower())
            known = [lookup(each).name for each in range(count)]
            raise SettingError(
                f"settings.{setting}: the model has no {kind.lower()} {said}"
                f"{nearest(said, known)}: it has {', '.join(filter(None, known)) or 'none'}"
            )
        return int(number)


def engine() -> Any:  # noqa: ANN401 - an optional module
    """Return MuJoCo; a RigError says how to install it."""
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise RigError(f"MuJoCo cannot be imported ({error}): install it with {INSTALL}") from None


def _joints(spec: Any, names: Iterable[str], kind: str) -> list[str]:  # noqa: ANN401 - of the engine
    """Return the joints that names of the form KIND:JOINT say."""
    joints = [name.partition(":")[2] for name in names if name.startswith(f"{kind}:")]
    known = [each.name for each in spec.joints]
    for joint in joints:
        if joint not in known:
            raise SettingError(
                f"settings: {kind}:{joint}: the model has no joint {joint}"
                f"{nearest(joint, known)}: it has {', '.join(known) or 'none'}"
            )
    return joints


def _add_motors(spec: Any, actuators: tuple[str, ...]) -> None:  # noqa: ANN401 - of the engine
    """Give joints a motor, as models of URDF files have none."""
    mujoco = engine()
    for joint in _joints(spec, actuators, "motor"):
        spec.add_actuator(name=f"motor_{joint}", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)


def _add_joint_sensors(mujoco: Any, spec: Any, sensors: tuple[str, ...]) -> None:  # noqa: ANN401
    for kind in ("jointpos", "jointvel"):
        for joint in _joints(spec, sensors, kind):
            spec.add_sensor(
                name=f"{kind}_{joint}",
                type=getattr(mujoco.mjtSensor, f"mjSENS_{kind.upper()}"),
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=joint,
            )
