"""Controlled step of a run on the simulated arm, in all forms, and what computed it."""

from __future__ import annotations

import math
import os
import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexarm_control.design.criteria import step_figures, strain_settling_s
from flexarm_core import __version__
from flexarm_ident.report.content.blocks import Plots, Words
from flexarm_ident.report.plots.time_plots import step_plot

if TYPE_CHECKING:
    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_control.design.criteria import StepFigures
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

SET_POINT_V = 3.0
# A move and its correction turn the compensation a few times.
_MANY_TURNS = 10
_VERSIONED = ("numpy", "scipy", "control", "numba", "rosbags", "mcap")


class ControlledStep(NamedTuple):
    """Recorded step from rest to `SET_POINT_V`, its figures, and when its vibration settled.

    From `calm_s` on, s, the strain at the base is within a tenth of its peak; infinite for never.
    """

    recorded: RecordedRun
    figures: StepFigures
    calm_s: float

    @classmethod
    def of(cls, recorded: RecordedRun) -> ControlledStep:
        """Return a run with the figures of its step."""
        data = recorded.reading.data
        figures = step_figures(_time_s(data), data.y[:, 0], SET_POINT_V)
        return cls(recorded, figures, strain_settling_s(data.y[:, 1], dt_s=data.dt_s))

    @property
    def text(self) -> str:
        """Figures for the terminal."""
        figures = self.figures
        return (
            f"mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
            f"overshoot {100 * figures.overshoot:.1f} %, "
            f"settling time (5 %) {_shown(figures.settling_s)}, "
            f"residual vibration settled after {_shown(self.calm_s)}"
        )

    @property
    def over_s(self) -> float:
        """Time from which the arm is at the set-point and its vibration settled, s."""
        return max(self.figures.settling_s, self.calm_s)

    def summary(self) -> dict[str, Any]:
        """Return the figures for `summary.json`."""
        figures = self.figures
        return {
            "set_point_v": SET_POINT_V,
            "mean_error_v": figures.mean_error_v,
            "overshoot": figures.overshoot,
            "settling_s": figures.settling_s if math.isfinite(figures.settling_s) else None,
            "calm_s": self.calm_s if math.isfinite(self.calm_s) else None,
        }

    def blocks(self, title: str) -> tuple[Words | Plots, ...]:
        """Return the step for a report."""
        data, figures = self.recorded.reading.data, self.figures
        words = (
            f"{title}, step to {SET_POINT_V:g} V. "
            f"Mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
            f"overshoot {100 * figures.overshoot:.1f} %, "
            f"settling time (5 %) {_shown(figures.settling_s)}, "
            f"residual vibration (base strain below a tenth of its peak) settled after "
            f"{_shown(self.calm_s)}."
        )
        set_point_v = np.full(len(data), SET_POINT_V)
        plot = step_plot(_time_s(data), data.y, set_point_v, data.u[:, 0])
        return Words(words), Plots((("", plot),)), *map(Words, switching_words(data))


def switching_words(data: IoData) -> list[str]:
    """Return what a compensation that turns again and again makes of the command; or nothing."""
    if data.compensation is None:
        return []
    acting_v = data.compensation[data.compensation != 0.0]
    turns = int(np.count_nonzero(np.diff(np.sign(acting_v))))
    if turns < _MANY_TURNS:
        return []
    level_v = float(np.abs(acting_v).max())
    words = (
        f"Where the command fills a band, the Coulomb compensation of ±{level_v:g} V switches, "
        f"here {turns} times: it has the sign of the effort (4-8), which is near zero there and "
        "turns with the least speed or noise. It makes up for friction."
    )
    return [words]


def _shown(time_s: float) -> str:
    """Return a time for people; one that never comes is a dash."""
    return f"{time_s:.2f} s" if math.isfinite(time_s) else "-"


def _time_s(data: IoData) -> FloatArray:
    return np.arange(len(data), dtype=np.float64) * data.dt_s


def versions() -> dict[str, str]:
    """Return the versions of what computed the results."""
    return {
        "python": platform.python_version(),
        "ros_distro": os.environ.get("ROS_DISTRO", "none"),
        "flexarm": __version__,
        **{name: version(name) for name in _VERSIONED},
    }
