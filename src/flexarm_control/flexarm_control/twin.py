"""Twin of an arm: a rig that moves as an identified model says, with its friction and noise."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flexarm_core.errors import FlexarmError, SettingError, nearest
from flexarm_core.signals import RigSample, steps_to
from flexarm_ident.friction.dry_friction import load_friction
from flexarm_ident.models.files import load_model, load_parameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import RigDescription
    from flexarm_ident.friction.dry_friction import DryFriction

STOP_REACHES: Final = 10.0
"""The force of a stop, in parts of the largest command of the joint's input."""
SLOW_HZ: Final = 0.05
"""Frequency at which an input moves the angle of its joint further than any other output."""


class TwinError(FlexarmError):
    """Twin that is not open, or has no number for a command."""


class _Stop(NamedTuple):
    """Ends of a joint's travel: places of input and angle, force, sign of an outward speed."""

    input: int
    angle: int
    low: float
    high: float
    force: float
    sign: float


class TwinRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` on an identified model.

    Time is virtual without a clock. The ends of a joint's travel are stops without a rebound.

    Parameters
    ----------
    model : str
        File of the model; a relative one is in the folder of the description. Or a packaged model,
        ``quanser_2dsfl``.
    noise : sequence of float, optional
        Standard deviation of each output; none by default.
    seed : int
        Seed of the noise.
    rig : RigDescription
        Description of the rig, whose signals are those of the model.
    folder : Path
        Its folder.

    Raises
    ------
    SettingError
        If the model has other signals or another rate, or there is no noise for each output.
    """

    def __init__(
        self,
        model: str,
        noise: Sequence[float] = (),
        seed: int = 0,
        *,
        rig: RigDescription,
        folder: Path,
    ) -> None:
        packaged = Path(str(files("flexarm_control.models"))) / "identified" / f"{model}.yaml"
        path = packaged if packaged.is_file() else folder / model
        plant = load_model(path)
        _require_signals(plant, rig, path)
        if len(noise) not in (0, len(rig.outputs)):
            raise SettingError(
                f"settings.noise has {len(noise)} entries for {len(rig.outputs)} outputs: "
                f"{', '.join(rig.output_names)}"
            )
        self.clock: Callable[[], float] | None = None
        self._dt_s, self._seed = float(plant.dt), seed
        # In the order of the description.
        inputs = [plant.input_labels.index(name) for name in rig.input_names]
        outputs = [plant.output_labels.index(name) for name in rig.output_names]
        self._a = np.ascontiguousarray(plant.A)
        self._b = np.ascontiguousarray(plant.B[:, inputs])
        self._c, self._d = plant.C[outputs], plant.D[np.ix_(outputs, inputs)]
        self._noise = np.array(noise or [0.0] * len(outputs), dtype=np.float64)
        self._rest = np.array([each.rest for each in rig.inputs])
        self._friction(load_friction(path), inputs)
        self._stops(rig)
        self._gain = self._speed @ self._b
        self._is_open = False

    def _friction(self, friction: DryFriction | None, inputs: Sequence[int]) -> None:
        self._laws, self._holds = np.zeros((len(inputs), 4)), np.zeros((len(inputs), 2))
        self._offsets = np.zeros(len(inputs))
        self._speed = np.zeros((len(inputs), len(self._a)))
        if friction is not None:
            self._laws = friction.laws[list(inputs)]
            self._holds = friction.holds[list(inputs)]
            self._offsets = friction.offsets[list(inputs)]
            self._speed = friction.speed[list(inputs)]

    def _stops(self, rig: RigDescription) -> None:
        """Note the travel of each joint; speeds that no friction opposes come from the angle."""
        self._ends: list[_Stop] = []
        for joint in rig.joints:
            driven = rig.input_names.index(joint.input)
            angle = rig.output_names.index(joint.angle)
            reach = max(abs(rig.inputs[driven].low), abs(rig.inputs[driven].high))
            force = STOP_REACHES * reach
            change = self._c[angle] @ (self._a - np.eye(len(self._a)))
            if not self._laws[driven, 0]:
                self._speed[driven] = change
            # Of the angle's change for a positive speed of its friction.
            sign = math.copysign(1.0, float(change @ self._speed[driven]))
            self._ends.append(_Stop(driven, angle, joint.low, joint.high, force, sign))

    @property
    def has_virtual_time(self) -> bool:
        """Whether time stands still between the samples."""
        return self.clock is None

    def open(self) -> None:
        """Start at rest, at time zero, with the noise's seed."""
        self._x = np.zeros(len(self._a))
        self._u = self._rest.copy()
        self._random = np.random.default_rng(self._seed)
        self._steps = 0
        self._has_sampled = False
        self._begun_s = self._moved_s = self.clock() if self.clock is not None else 0.0
        self._advance(0)
        self._is_open = True

    def read(self) -> RigSample:
        """Sample the outputs with noise."""
        self._require_open()
        time_s = self._steps * self._dt_s
        if self.clock is not None:
            now_s = self.clock()
            steps, self._moved_s = steps_to(now_s, self._moved_s, self._dt_s)
            self._advance(steps)
            time_s = now_s - self._begun_s
        elif self._has_sampled:
            self._advance(1)
            time_s = self._steps * self._dt_s
        self._has_sampled = True
        noise = self._noise * self._random.standard_normal(len(self._noise))
        outputs = self._c @ self._x + self._d @ (self._u - self._offsets) + noise
        return RigSample(time_s, outputs)

    def write(self, commands: Sequence[float]) -> None:
        """Command the drives until the next write."""
        self._require_open()
        values = np.asarray(commands, dtype=np.float64)
        if values.shape != self._u.shape or not np.isfinite(values).all():
            raise TwinError(f"commands must be {len(self._u)} finite numbers, got {commands}")
        if self.clock is not None:
            steps, self._moved_s = steps_to(self.clock(), self._moved_s, self._dt_s)
            self._advance(steps)
        self._u = values

    def safe_stop(self) -> None:
        """Set the drives to rest; never raises."""
        if self._is_open:
            self._u = self._rest.copy()

    def close(self) -> None:
        """Set the drives to rest and close."""
        self.safe_stop()
        self._is_open = False

    def _require_open(self) -> None:
        if not self._is_open:
            raise TwinError("the twin is not open: call open() first")

    def _advance(self, steps: int) -> None:
        # It loads a compiler, which a description that is only checked does not need.
        from flexarm_ident.models.stick_slip import (  # noqa: PLC0415
            friction_force,
            friction_levels,
        )

        for _ in range(steps):
            after = self._a @ self._x + self._b @ (self._u - self._offsets)
            speeds, ahead = self._speed @ self._x, self._speed @ after
            levels = friction_levels(self._laws, speeds, np.abs(self._u))
            rests, gives = self._holds.T.copy()
            # A stop holds without yielding.
            for stop in self._stopped(self._c @ self._x, ahead):
                levels[stop.input] = stop.force
                rests[stop.input] = gives[stop.input] = 0.0
            gain = self._gain + np.diag(np.diag(self._gain) * gives)
            self._x = after - self._b @ friction_force(ahead - rests * speeds, gain, levels)
            self._steps += 1

    def _stopped(self, outputs: FloatArray, speeds: FloatArray) -> Iterator[_Stop]:
        """Yield the stops that a joint moves against."""
        for stop in self._ends:
            outward = stop.sign * speeds[stop.input]
            if (outputs[stop.angle] >= stop.high and outward > 0.0) or (
                outputs[stop.angle] <= stop.low and outward < 0.0
            ):
                yield stop


def _require_signals(model: control.StateSpace, rig: RigDescription, path: Path) -> None:
    for role, wanted, known in (
        ("input", rig.input_names, model.input_labels),
        ("output", rig.output_names, model.output_labels),
    ):
        for name in wanted:
            if name not in known:
                raise SettingError(
                    f"{path}: the model has no {role} {name}{nearest(name, known)}: a twin has "
                    f"the signals of its model, {', '.join(known)}"
                )
        if len(wanted) != len(known):
            raise SettingError(
                f"{path}: the model has the {role}s {', '.join(known)}, and the description "
                f"{', '.join(wanted)}: name all of them"
            )
    rate_hz = 1.0 / float(model.dt)
    if abs(rate_hz / rig.rate_hz - 1.0) > 1e-6:  # noqa: PLR2004 - rounding of a period
        raise SettingError(
            f"{path}: the model is of {rate_hz:g} Hz and rate_hz = {rig.rate_hz:g}: they are one"
        )


def twin_description(path: Path) -> str:
    """Return the description of an identified model's twin, as YAML text to be looked at.

    Limits are those of the record, travels half as wide again. The output that an input moves
    furthest is the angle of a joint.

    Parameters
    ----------
    path : Path
        File of the model.

    Raises
    ------
    ModelFileError
        If the file cannot be read.
    """
    model = load_model(path)
    facts = {key.rpartition(".")[2]: value for key, value in load_parameters(path).items()}
    return "\n".join(_description(model, load_friction(path), facts, path)) + "\n"


def _description(
    model: control.StateSpace,
    friction: DryFriction | None,
    facts: Mapping[str, object],
    path: Path,
) -> Iterator[str]:
    rate_hz = 1.0 / float(model.dt)
    yield f"# Twin of the model {path.name}: look at units, limits and joints."
    yield f"name: {_word(path.parent.name or path.stem)}_twin"
    yield f"rate_hz: {round(rate_hz, 9):g}"
    yield "inputs:"
    reaches = _widths(facts, "input", model.ninputs)
    for name, (low, high) in zip(model.input_labels, reaches, strict=True):
        reach = max(abs(low), abs(high), 1e-9)
        yield f"  {name}: {{unit: '-', limits: {_rounded(reach)}}}"
    yield "outputs:"
    ranges = _widths(facts, "output", model.noutputs)
    joints = _angles(model, ranges)
    for name, (low, high) in zip(model.output_labels, ranges, strict=True):
        if name in joints.values():
            unit = "deg" if max(abs(low), abs(high)) > 2.0 * math.pi else "rad"
            yield f"  {name}: {{quantity: angle, unit: {unit}}}"
        else:
            yield f"  {name}: {{unit: '-'}}"
    if joints:
        yield "joints:"
    for place, (driven, angle) in enumerate(joints.items()):
        low, high = ranges[model.output_labels.index(angle)]
        reach = max(abs(low), abs(high), 1e-9)
        yield f"  joint_{place + 1}:"
        yield f"    input: {driven}"
        yield f"    angle: {angle}"
        yield f"    travel: {_rounded(1.5 * reach)}"
        if friction is not None:
            level = friction.levels[model.input_labels.index(driven)]
            yield f"    coulomb: {_rounded(float(level))}"
    yield "driver: twin"
    yield "settings:"
    yield f"  model: {path.absolute()}"
    noise = facts.get("noise_sd")
    if isinstance(noise, list) and len(noise) == model.noutputs:
        yield f"  noise: [{', '.join(f'{float(each):.4g}' for each in noise)}]"


def _angles(model: control.StateSpace, ranges: Sequence[tuple[float, float]]) -> dict[str, str]:
    """Return by input the output that it moves furthest at a slow pace, in parts of its range."""
    response = model(np.exp(2j * np.pi * np.array([SLOW_HZ]) * float(model.dt)))
    gains = np.abs(np.reshape(response, (model.noutputs, model.ninputs)))
    widths = np.array([max(high - low, 1e-300) for low, high in ranges])
    moved = gains / widths[:, None]
    found: dict[str, str] = {}
    for _ in range(min(model.ninputs, model.noutputs)):
        row, column = np.unravel_index(np.argmax(moved), moved.shape)
        found[model.input_labels[column]] = model.output_labels[row]
        moved[row, :] = moved[:, column] = -1.0
    return {name: found[name] for name in model.input_labels if name in found}


def _widths(facts: Mapping[str, object], role: str, count: int) -> list[tuple[float, float]]:
    """Return the ends of the signals in the record; one both ways where the model has none."""
    ends = []
    for name, usual in (("low", -1.0), ("high", 1.0)):
        values: Any = facts.get(f"{role}_{name}")
        known = isinstance(values, list) and len(values) == count
        ends.append([float(each) for each in values] if known else [usual] * count)
    return list(zip(*ends, strict=True))


def _rounded(value: float) -> str:
    return f"{value:.3g}"


def _word(name: str) -> str:
    return "".join(each if each.isalnum() else "_" for each in name).strip("_") or "arm"
