"""Linear models with dry friction at their inputs: simulation, net input, ROS parameters.

A model `arm` with friction has the parameters `models.arm.friction_level` and
`models.arm.friction_offset`, their standard deviations `friction_level_std` and
`friction_offset_std`, all with one entry per input in the input's unit, and `friction_speed`, the
row-major map from the state to the opposed speeds. Where the friction also depends on speed and
load, there are `friction_rise`, `friction_rise_speed`, `friction_load`, `friction_rise_std` and
`friction_load_std` as well. `friction_rest` and `friction_give`, one entry per input, say how it
yields below its level; without them the drive stands still there. A model without friction has none
of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.models.files import load_model, load_parameters
from flexarm_ident.models.model_parameters import ModelFileError
from flexarm_ident.models.state_space import simulate_states

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

# Their order is that of the attributes.
_ATTRIBUTES = ("levels", "offsets", "level_deviations", "offset_deviations", "speed")
_FIELDS = (
    "friction_level",
    "friction_offset",
    "friction_level_std",
    "friction_offset_std",
    "friction_speed",
)
# Their order is that of `Dependence`.
_FIELDS_OF_DEPENDENCE = (
    "friction_rise",
    "friction_rise_speed",
    "friction_load",
    "friction_rise_std",
    "friction_load_std",
)
_FIELDS_OF_YIELDING = ("friction_rest", "friction_give")
_ALL_FIELDS = (*_FIELDS, *_FIELDS_OF_DEPENDENCE, *_FIELDS_OF_YIELDING)


class Yielding(NamedTuple):
    """How friction below its level lets a drive creep: it leaves part of the speed after a step.

    Attributes
    ----------
    rests : ndarray, (inputs,)
        Part of the speed that is left after one sampling period, 0 for a drive that stands still.
    gives : ndarray, (inputs,)
        Part of the holding force that is missing.
    """

    rests: FloatArray
    gives: FloatArray


class Dependence(NamedTuple):
    """How friction depends on speed v and load: level + rise exp(-(v / rise_speed)^2) + load |u|.

    Attributes
    ----------
    rises, rise_speeds : ndarray, (inputs,)
        Rise of each level at standstill, in the input's unit, and the speed over which it fades.
        An input without a rise has zeros.
    loads : ndarray, (inputs,)
        Part of the input's size that adds to the level.
    rise_deviations, load_deviations : ndarray, (inputs,)
        Their standard deviations.
    """

    rises: FloatArray
    rise_speeds: FloatArray
    loads: FloatArray
    rise_deviations: FloatArray
    load_deviations: FloatArray


@dataclass(frozen=True, eq=False)
class DryFriction:
    """Dry friction at the inputs of a model.

    With the offset, the level forwards is ``level + offset`` and backwards ``level - offset``.

    Attributes
    ----------
    levels, offsets : ndarray, (inputs,)
        Coulomb friction level and constant offset of each input, in its unit.
    level_deviations, offset_deviations : ndarray, (inputs,)
        Their standard deviations.
    speed : ndarray, (inputs, states)
        Map from the model's state to the opposed speeds.
    dependence : Dependence, optional
        How the levels depend on speed and load.
    yielding : Yielding, optional
        How friction yields below its level.
    """

    levels: FloatArray
    offsets: FloatArray
    level_deviations: FloatArray
    offset_deviations: FloatArray
    speed: FloatArray
    dependence: Dependence | None = None
    yielding: Yielding | None = None

    @property
    def holds(self) -> FloatArray:
        """How the friction yields, as `stick_slip.run` takes it, (inputs, 2)."""
        if self.yielding is None:
            return np.zeros((len(self.levels), 2))
        return np.column_stack(self.yielding)

    @property
    def laws(self) -> FloatArray:
        """The friction as `stick_slip.friction_levels` takes it, (inputs, 4)."""
        laws = np.zeros((len(self.levels), 4))
        laws[:, 0] = self.levels
        if self.dependence is not None:
            laws[:, 1:] = np.column_stack(self.dependence[:3])
        return laws


def simulate_with_friction(
    model: control.StateSpace, friction: DryFriction, u: FloatArray, x0: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Simulate a model under the measured input alone, with friction inside.

    The friction follows from the simulated speeds; measured outputs are not used.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model from the net input, without feedthrough.
    friction : DryFriction
        Friction at its inputs.
    u : ndarray, (samples, inputs)
        Measured input.
    x0 : ndarray, (states,)
        Initial state.

    Returns
    -------
    ndarray, (samples, outputs)
        Outputs.
    ndarray, (samples, inputs)
        Friction, in units of the input. The linear model gives the same outputs for the input
        without friction and offset.
    """
    from flexarm_ident.models.stick_slip import run  # noqa: PLC0415 - numba loads slowly

    A, B = np.ascontiguousarray(model.A), np.ascontiguousarray(model.B)
    start = np.asarray(x0, dtype=np.float64)
    net, sizes = u - friction.offsets, np.abs(u)
    x, forces = run(A, B, friction.speed, friction.laws, friction.holds, net, sizes, start)
    return x @ model.C.T, forces


def net_records(
    model: control.StateSpace,
    friction: DryFriction,
    x0: Sequence[FloatArray],
    records: Sequence[IoData],
) -> tuple[IoData, ...]:
    """Return records with the net input of the linear model: without offset and friction.

    The model, its friction and the initial state of each record are those of
    `simulate_with_friction`.
    """
    nets = []
    for record, start in zip(records, x0, strict=True):
        _, forces = simulate_with_friction(model, friction, record.u, start)
        nets.append(replace(record, u=record.u - friction.offsets - forces))
    return tuple(nets)


def refer_friction(
    friction: DryFriction,
    models: tuple[control.StateSpace, control.StateSpace],
    x0: tuple[Sequence[FloatArray], Sequence[FloatArray]],
    nets: Sequence[IoData],
) -> DryFriction:
    """Refer the friction of one model to another of the same arm, such as a reduced one.

    The levels stay; the speeds follow from the other model's states by least squares. The pairs
    hold the first model and the other one, and their initial states, (states,), per record; the
    records have the net input of `net_records`.
    """
    first, other = (
        np.vstack(
            [
                simulate_states(model.A, model.B, record.u, start)
                for record, start in zip(nets, starts, strict=True)
            ]
        )
        for model, starts in zip(models, x0, strict=True)
    )
    rows = np.linalg.lstsq(other, first @ friction.speed.T, rcond=None)[0].T
    return replace(friction, speed=np.ascontiguousarray(rows))


def friction_fields(friction: DryFriction | None) -> dict[str, list[float]]:
    """Return friction as fields of a model's parameters, by name; none without friction."""
    if friction is None:
        return {}
    named = dict(zip(_FIELDS, (getattr(friction, each) for each in _ATTRIBUTES), strict=True))
    if friction.dependence is not None:
        named |= zip(_FIELDS_OF_DEPENDENCE, friction.dependence, strict=True)
    if friction.yielding is not None:
        named |= zip(_FIELDS_OF_YIELDING, friction.yielding, strict=True)
    return {field: np.ravel(value).tolist() for field, value in named.items()}


def load_friction(path: Path | str) -> DryFriction | None:
    """Read the dry friction beside the model of a file that `load_model` reads.

    Parameters
    ----------
    path : Path or str
        File of an identification, or of `save_model` with `friction_fields` in its provenance.

    Returns
    -------
    DryFriction or None
        The friction for `simulate_with_friction`; None when the model has none.

    Raises
    ------
    ModelFileError
        If the file or its model cannot be read, or a field of the friction is missing or does not
        fit the model.
    """
    model = load_model(path)
    found = {
        field: value
        for key, value in load_parameters(path).items()
        if (field := key.rpartition(".")[2]) in _ALL_FIELDS
    }
    if not found:
        return None
    rows = (model.ninputs,)
    *per_input, speed_field = _FIELDS
    levels, offsets, *scatter = (_array(path, found, field, rows) for field in per_input)
    speed = _array(path, found, speed_field, (model.ninputs, model.nstates))
    dependence = None
    if any(field in found for field in _FIELDS_OF_DEPENDENCE):
        values = (_array(path, found, field, rows) for field in _FIELDS_OF_DEPENDENCE)
        dependence = Dependence(*values)
    yielding = None
    if any(field in found for field in _FIELDS_OF_YIELDING):
        yielding = Yielding(*(_array(path, found, field, rows) for field in _FIELDS_OF_YIELDING))
    return DryFriction(levels, offsets, scatter[0], scatter[1], speed, dependence, yielding)


def _array(
    path: Path | str, found: dict[str, object], field: str, size: tuple[int, ...]
) -> FloatArray:
    try:
        entries = np.array(found[field], dtype=np.float64).reshape(size)
    except (KeyError, TypeError, ValueError):
        entries = np.array(np.nan)
    if not np.isfinite(entries).all():
        raise ModelFileError(
            f"{path}: {field} is missing or does not fit the model: write the file again"
        )
    return entries
