"""Flexible arms drawn at random, in MuJoCo: records of them, and their linear models.

Each link is a row of segments on hinges with springs; each joint has dry and viscous friction. An
arm has one of three sets of sensors: encoder, gyro and an accelerometer at the tip; encoder and two
bends; or two links with a motor, an encoder and a bend each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import control
import numpy as np

from flexarm_control.servo.job import Source
from flexarm_daq.drivers.mujoco.rig import MujocoArm, MujocoRig, MujocoSettings
from flexarm_ident.friction.dry_friction import DryFriction

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flexarm_core.arrays import FloatArray

RATE_HZ = 500
LIMIT_NM = 3.0
_SEGMENTS, _SUBSTEPS = 10, 4
_MOTOR_KG = 0.3
# Outputs of each kind by name: the sensor that MuJoCo calls so, and its noise in SI units.
_SENSORS: dict[str, dict[str, tuple[str, float]]] = {
    "gyro": {"hub": ("hub0", 1e-4), "rate": ("gyro[2]", 1e-3), "tip_acc": ("acc[1]", 2e-2)},
    "bends": {"hub": ("hub0", 1e-4), "bend_base": ("near0", 1e-5), "bend_mid": ("far0", 1e-5)},
    "two links": {
        "hub1": ("hub0", 1e-4),
        "hub2": ("hub1", 1e-4),
        "bend1": ("near0", 1e-5),
        "bend2": ("near1", 1e-5),
    },
}


@dataclass(frozen=True)
class Link:
    """A link and the joint at its root, in SI units; `stiffness` is that of a hinge."""

    length_m: float
    mass_kg: float
    stiffness: float
    damping: float
    friction_nm: float
    viscous: float
    armature: float


@dataclass(frozen=True)
class DrawnArm:
    """An arm; its names of inputs, outputs and tracked outputs are those of its record."""

    kind: str
    seed: int
    links: tuple[Link, ...]
    tip_kg: float

    @property
    def inputs(self) -> list[str]:
        """Names of the torques."""
        return [f"torque{i + 1}" if len(self.links) > 1 else "torque" for i in self.joints]

    @property
    def outputs(self) -> list[str]:
        """Names of the sensors."""
        return list(_SENSORS[self.kind])

    @property
    def tracked(self) -> list[str]:
        """Names of the encoders."""
        return self.outputs[: len(self.links)]

    @property
    def joints(self) -> range:
        """Numbers of the joints."""
        return range(len(self.links))

    def rig(
        self, folder: Path, *, tip: float = 1.0, seed: int = 0, noise: bool = True
    ) -> MujocoRig:
        """Return the arm with another tip mass, as a part of its own."""
        settings = self._settings(folder, tip, seed)
        return MujocoRig(settings if noise else replace(settings, noise=()), folder)

    def source(self, folder: Path) -> Source:
        """Return MuJoCo's linear model at rest, and the true friction."""
        arm = MujocoArm(self._settings(folder, 1.0, 0), folder)
        model, data, engine = arm.model, arm.data, arm._mujoco  # noqa: SLF001 - a second look
        model.dof_frictionloss[:] = 0.0
        engine.mj_forward(model, data)
        states, joints = 2 * model.nv, len(self.links)
        one, push = np.zeros((states, states)), np.zeros((states, joints))
        shown, direct = (np.zeros((model.nsensordata, size)) for size in (states, joints))
        engine.mjd_transitionFD(model, data, 1e-6, True, one, push, shown, direct)  # noqa: FBT003
        A, B = np.eye(states), np.zeros((states, joints))
        for _ in range(arm.substeps):
            A, B = one @ A, one @ B + push
        rows = arm._outputs  # noqa: SLF001
        speed = np.zeros((joints, states))
        for i in self.joints:
            speed[i, model.nv + model.joint(f"hub{i}").dofadr[0]] = 1.0
        names: dict[str, Any] = {"inputs": self.inputs, "outputs": self.outputs}
        linear = control.StateSpace(A, B, shown[rows], direct[rows], 1.0 / RATE_HZ, **names)
        levels = np.array([link.friction_nm for link in self.links])
        unknown = np.zeros(joints)
        friction = DryFriction(levels, unknown, unknown, unknown, speed)
        return Source("linearisation", linear, friction)

    def _settings(self, folder: Path, tip: float, seed: int) -> MujocoSettings:
        sensors = _SENSORS[self.kind].values()
        model = f"{self.kind.replace(' ', '_')}_{self.seed}_{tip:g}.xml"
        (folder / model).write_text(self._xml(tip), "utf-8")
        return MujocoSettings(
            model=model,
            actuators=tuple(f"motor{i}" for i in self.joints),
            sensors=tuple(name for name, _ in sensors),
            noise=tuple(noise for _, noise in sensors),
            seed=seed,
            substeps=_SUBSTEPS,
            rate_hz=float(RATE_HZ),
        )

    def _xml(self, tip: float) -> str:
        tip_kg = tip * self.tip_kg
        inner = f'<geom type="sphere" size=".02" mass="{tip_kg}"/><site name="tip"/>'
        for number in reversed(self.joints):
            inner = _link_xml(number, self.links[number], inner)
        hubs = [f"hub{i}" for i in self.joints]
        motors = "".join(
            f'<motor name="motor{i}" joint="{hub}" ctrllimited="true" '
            f'ctrlrange="-{LIMIT_NM} {LIMIT_NM}"/>'
            for i, hub in enumerate(hubs)
        )
        angles = {hub: hub for hub in hubs}
        for i in self.joints:
            angles |= {f"near{i}": f"bend{i}_1", f"far{i}": f"bend{i}_{_SEGMENTS // 2}"}
        read = "".join(f'<jointpos name="{n}" joint="{joint}"/>' for n, joint in angles.items())
        return (
            '<mujoco><option gravity="0 0 0" integrator="implicitfast"/><default>'
            '<geom contype="0" conaffinity="0"/><joint type="hinge" axis="0 0 1"/></default>'
            f"<worldbody>{inner}</worldbody><actuator>{motors}</actuator><sensor>{read}"
            '<gyro name="gyro" site="site0"/><accelerometer name="acc" site="tip"/>'
            "</sensor></mujoco>"
        )


def drawn_arm(seed: int) -> DrawnArm:
    """Draw an arm; the kinds take turns."""
    rng = np.random.default_rng(seed)
    kind = list(_SENSORS)[seed % len(_SENSORS)]
    count = 2 if kind == "two links" else 1
    tip_kg, links = float(rng.uniform(0.05, 0.2)), []
    carried_kg = tip_kg
    for _ in range(count):
        length_m = rng.uniform(0.4, 0.9) / count**0.5
        mass_kg = rng.uniform(0.1, 0.35)
        # Of a clamped link with its load.
        speed = 2.0 * np.pi * rng.uniform(3.0, 8.0)
        stiffness = speed**2 * (carried_kg + 0.24 * mass_kg) * length_m**2 * _SEGMENTS / 3.0
        damping = 2.0 * rng.uniform(0.004, 0.012) * stiffness / speed
        friction_nm = np.exp(rng.uniform(np.log(0.02), np.log(0.08)))
        others = (friction_nm, rng.uniform(0.01, 0.04), rng.uniform(0.005, 0.02))
        links.append(Link(*map(float, (length_m, mass_kg, stiffness, damping, *others))))
        carried_kg += mass_kg + _MOTOR_KG
    return DrawnArm(kind, seed, tuple(reversed(links)), tip_kg)


def record_arm(arm: DrawnArm, folder: Path, seconds: float) -> Path:
    """Record an arm under a soft position loop with dither, as CSV, and return the file."""
    rng = np.random.default_rng(arm.seed)
    count = len(arm.links)
    rig = arm.rig(folder, seed=arm.seed)
    rig.open()
    loads = np.array([_inertia(arm.links[i:], arm.tip_kg) for i in arm.joints])
    levels = np.array([link.friction_nm for link in arm.links])
    stiff, calm = loads * 14.0, loads * 5.3
    goal, left, last, speed = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    rows = []
    for k in range(round(seconds * RATE_HZ)):
        y = np.asarray(rig.read().outputs)
        for i in np.flatnonzero(left <= 0.0):
            goal[i], left[i] = rng.uniform(-0.4, 0.4), rng.uniform(0.3, 1.8) * RATE_HZ
        left -= 1.0
        speed += 0.2 * ((y[:count] - last) * RATE_HZ - speed)
        last = y[:count]
        missed = goal - last
        u = stiff * missed - calm * speed + levels * np.sign(missed)
        u = np.clip(u + 0.05 * rng.standard_normal(count), -LIMIT_NM, LIMIT_NM)
        rig.write(u.tolist())
        rows.append([k / RATE_HZ, *u, *y])
    file = folder / f"arm_{arm.seed}.csv"
    head = ",".join(["time", *arm.inputs, *arm.outputs])
    np.savetxt(file, rows, delimiter=",", header=head, comments="", fmt="%.9g")
    return file


def step_arm(arm: DrawnArm, folder: Path, law: Any, goal: FloatArray, tip: float) -> FloatArray:  # noqa: ANN401 - whatever has the methods of a servo
    """Return the tracked outputs of a step from the step on, (samples, tracked), with noise."""
    rig = arm.rig(folder, tip=tip, seed=arm.seed + 1)
    rig.open()
    law.reset()
    rest, rows = np.zeros(len(goal)), []
    before, behind = RATE_HZ // 5, 8 * RATE_HZ
    for k in range(before + behind):
        y = rig.read().outputs
        rig.write(law.step(y, goal if k >= before else rest))
        rows.append(y[: len(goal)])
    return np.array(rows[before:])


def _inertia(links: Sequence[Link], tip_kg: float) -> float:
    reach_m = sum(link.length_m for link in links)
    carried = tip_kg + sum(link.mass_kg for link in links) / 3.0 + 0.3 * (len(links) - 1)
    return float(links[0].armature + carried * reach_m**2)


def _link_xml(number: int, link: Link, inner: str) -> str:
    piece_m, piece_kg = link.length_m / _SEGMENTS, link.mass_kg / _SEGMENTS
    text = f'<body pos="{piece_m} 0 0">{inner}</body>'
    for i in reversed(range(_SEGMENTS)):
        joint = (
            f'<joint name="bend{number}_{i}" stiffness="{link.stiffness}" '
            f'damping="{link.damping}"/>'
        )
        text = (
            f'<body pos="{piece_m if i else 0.0} 0 0">{joint if i else ""}<geom type="box" '
            f'size="{0.5 * piece_m} .001 .02" pos="{0.5 * piece_m} 0 0" mass="{piece_kg}"/>'
            f"{text}</body>"
        )
    return (
        f'<body><joint name="hub{number}" damping="{link.viscous}" armature="{link.armature}" '
        f'frictionloss="{link.friction_nm}"/><site name="site{number}"/>'
        f'<geom type="cylinder" size=".03 .03" mass="{_MOTOR_KG}"/>{text}</body>'
    )
