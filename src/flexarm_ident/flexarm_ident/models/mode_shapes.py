"""Mode shapes at the sensors: how the outputs move against each other in one mode.

An oscillating mode is the sum of a complex pair; its part in the outputs is the column of C in
modal coordinates (2-27), whose magnitudes are the amplitudes and whose angles are the phases.
Ewins, "Modal Testing", chapter 2 (2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.models.modes import frequency_and_damping, modal_form

if TYPE_CHECKING:
    import control

    from flexarm_core.arrays import ComplexArray, FloatArray


@dataclass(frozen=True, eq=False)
class ModeShape:
    """Shape of an oscillating mode.

    Attributes
    ----------
    frequency_hz : float
        Natural frequency.
    damping_ratio : float
        Damping ratio.
    values : ndarray, (outputs,)
        Complex amplitudes of the scaled outputs; that of the output that moves most is 1.
    """

    frequency_hz: float
    damping_ratio: float
    values: ComplexArray

    @property
    def magnitude(self) -> FloatArray:
        """Amplitude of each output, (outputs,), from 0 to 1."""
        return np.asarray(np.abs(self.values))

    @property
    def phase_deg(self) -> FloatArray:
        """Phase of each output, (outputs,), before the one that moves most; -180 to 180."""
        return np.asarray(np.degrees(np.angle(self.values)))


def mode_shapes(model: control.StateSpace, output_scale: FloatArray) -> tuple[ModeShape, ...]:
    """Return the shapes of the oscillating modes that any output shows, by rising frequency.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    output_scale : ndarray, (outputs,)
        Factors that make the outputs comparable, such as one over their RMS.
    """
    form = modal_form(model)
    found = []
    for group in form.groups:
        seen = form.C[:, group[0]] * output_scale
        largest = seen[np.argmax(np.abs(seen))]
        if len(group) > 1 and largest != 0.0:
            figures = frequency_and_damping(complex(form.eigenvalues[group[0]]), form.dt_s)
            found.append(ModeShape(*figures, seen / largest))
    return tuple(sorted(found, key=lambda shape: shape.frequency_hz))
