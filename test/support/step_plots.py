"""Plot of a step, to be put into reports."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.report.plots.time_plots import step_plot
from support.ident_systems import DT_S

if TYPE_CHECKING:
    from numpy.typing import NDArray


def times(samples: int) -> NDArray[np.float64]:
    return np.linspace(0.0, (samples - 1) * DT_S, samples)


def a_step() -> str:
    time_s = times(300)
    volts = np.outer(1.0 - np.exp(-5.0 * time_s), [3.0, 0.5, 0.2, 0.1])
    return step_plot(time_s, volts, np.full(300, 3.0), 3.0 - volts[:, 0])
