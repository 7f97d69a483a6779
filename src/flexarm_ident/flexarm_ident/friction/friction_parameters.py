"""Dry friction as ROS parameters beside its model, without loss.

A model `arm` with friction has the parameters `models.arm.friction_level` and
`models.arm.friction_offset`, their standard deviations `friction_level_std` and
`friction_offset_std`, all with one entry per input in the input's unit, and `friction_speed`, the
row-major matrix that takes the opposed speeds from the state. A model without has none of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.friction.dry_friction import DryFriction
from flexarm_ident.models.model_parameters import (
    ModelFileError,
    model_fields,
    model_from_parameters,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_ident.models.model_parameters import ParameterValue

# In the order of `DryFriction`.
FIELDS = (
    "friction_level",
    "friction_offset",
    "friction_level_std",
    "friction_offset_std",
    "friction_speed",
)


def friction_fields(friction: DryFriction | None) -> dict[str, list[float]]:
    """Return friction as fields of a model's parameters, by the names of `FIELDS`; none without."""
    if friction is None:
        return {}
    values = (
        friction.levels,
        friction.offsets,
        friction.level_deviations,
        friction.offset_deviations,
        friction.speed,
    )
    return {field: np.ravel(value).tolist() for field, value in zip(FIELDS, values, strict=True)}


def friction_from_parameters(
    name: str, parameters: Mapping[str, ParameterValue]
) -> DryFriction | None:
    """Return the friction among the flat parameters of a model, None without friction.

    Raises
    ------
    ModelFileError
        If a field is missing, has the wrong size or type, or the model is damaged.
    """
    fields = model_fields(name, parameters)
    if not any(field in fields for field in FIELDS):
        return None
    model = model_from_parameters(name, parameters)
    sizes = (*(model.ninputs for _ in FIELDS[:-1]), model.ninputs * model.nstates)
    columns = []
    for field, size in zip(FIELDS, sizes, strict=True):
        try:
            values = np.array(fields.get(field), dtype=np.float64)
        except (TypeError, ValueError):
            values = np.array(np.nan)
        if values.shape != (size,) or not np.isfinite(values).all():
            raise ModelFileError(f"models.{name}.{field} must be a list of {size} finite numbers")
        columns.append(values)
    levels, offsets, level_deviations, offset_deviations, speed = columns
    return DryFriction(
        levels,
        offsets,
        level_deviations,
        offset_deviations,
        speed.reshape(model.ninputs, model.nstates),
    )
