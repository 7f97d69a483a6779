"""Check of a record, sample by sample, against what a description allows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexarm_core.rig_description import RigDescription
    from flexarm_ident import IoData

_ROUNDING = 1e-9


def passed_limits(record: IoData, rig: RigDescription) -> list[str]:
    """Return the limits of the inputs and the travels that a record passes, in words.

    A command is that which acts from its sample on. Each input begins at rest.
    """
    found = []
    for place, name in enumerate(record.inputs):
        limits = rig.input(name)
        u = record.u[:, place]
        steps = np.abs(np.diff(u, prepend=limits.rest)) / (1.0 + _ROUNDING)
        found += [
            f"{name} {what} at sample {samples[0]}"
            for what, samples in (
                ("beyond its limits", np.flatnonzero(_beyond(u, limits.low, limits.high))),
                (
                    "beyond its slew",
                    np.flatnonzero(steps > limits.slew_per_s * record.dt_s),
                ),
            )
            if samples.size
        ]
    for joint in rig.joints:
        u = record.u[:, record.inputs.index(joint.input)] - rig.input(joint.input).rest
        angle = record.y[:, record.outputs.index(joint.angle)]
        outside = _beyond(angle, joint.low, joint.high)
        outward = joint.sign * u * np.sign(angle - joint.middle) > _ROUNDING
        if np.any(outside & outward):
            found.append(f"{joint.input} drives {joint.name} on beyond its travel")
        if outside.any():
            found.append(f"{joint.name} beyond its travel at sample {np.flatnonzero(outside)[0]}")
    return found


def _beyond(values: np.ndarray, low: float, high: float) -> np.ndarray:
    return (values < low - _ROUNDING) | (values > high + _ROUNDING)
