"""Results of a run on the simulated arm: the model on the terminal, the step in all forms."""

from __future__ import annotations

import math
import os
import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rclpy.parameter import Parameter

from flexarm_bringup.console import terminal
from flexarm_control.design.criteria import step_figures
from flexarm_ident.records.iodata import ARM_OUTPUTS
from flexarm_ident.report.content.blocks import Plots, Words
from flexarm_ident.report.plots.time_plots import step_plot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_control.design.criteria import StepFigures
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_msgs.msg import ModeSummary
    from flexarm_msgs.srv import Identify

SET_POINT_V = 3.0
_VERSIONED = ("flexarm_bringup", "numpy", "scipy", "control", "numba", "rosbags", "mcap")


class ControlledStep(NamedTuple):
    """Recorded step from rest to `SET_POINT_V`, and its figures."""

    recorded: RecordedRun
    figures: StepFigures

    @classmethod
    def of(cls, recorded: RecordedRun) -> ControlledStep:
        """Return a run with the figures of its step."""
        data = recorded.reading.data
        return cls(recorded, step_figures(_time_s(data), data.y[:, 0], SET_POINT_V))

    @property
    def text(self) -> str:
        """Figures for the terminal."""
        figures = self.figures
        settled = f"{figures.settling_s:.2f} s" if math.isfinite(figures.settling_s) else "-"
        return (
            f"mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
            f"overshoot {100 * figures.overshoot:.1f} %, settled after {settled}"
        )

    def summary(self) -> dict[str, Any]:
        """Return the figures for `summary.json`."""
        figures = self.figures
        return {
            "set_point_v": SET_POINT_V,
            "mean_error_v": figures.mean_error_v,
            "overshoot": figures.overshoot,
            "settling_s": figures.settling_s if math.isfinite(figures.settling_s) else None,
        }

    def blocks(self, title: str) -> tuple[Words, Plots]:
        """Return the step for a report."""
        data, figures = self.recorded.reading.data, self.figures
        words = (
            f"{title}, step to {SET_POINT_V:g} V. "
            f"Mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
            f"overshoot {100 * figures.overshoot:.1f} %, "
            f"within 5 % after {figures.settling_s:.2f} s."
        )
        set_point_v = np.full(len(data), SET_POINT_V)
        plot = step_plot(_time_s(data), data.y, set_point_v, data.u[:, 0])
        return Words(words), Plots((("", plot),))


def _time_s(data: IoData) -> FloatArray:
    return np.arange(len(data), dtype=np.float64) * data.dt_s


def given_parameters(response: Identify.Response) -> dict[str, Any]:
    """Return the parameters of an identified model by their names."""
    return {each.name: Parameter.from_parameter_msg(each).value for each in response.parameters}


def show_model(response: Identify.Response) -> None:
    """Print modes, errors and warnings of the identified model."""
    terminal.CONSOLE.print(f"  {response.message}")
    terminal.show_model(
        terminal.ShownModel(
            modes=response.modes,
            outputs=ARM_OUTPUTS,
            dmv=response.dmv,
            left_out=response.left_out,
            sfv=response.sfv,
            parameters=given_parameters(response),
            warnings=response.warnings,
        )
    )


def states_of(mode: ModeSummary) -> int:
    """Return the states of a mode: two of a complex pair, one of a real eigenvalue."""
    return 2 if mode.eigenvalue_imaginary > 0.0 else 1


def kept_modes_hz(response: Identify.Response, known_modes_hz: Sequence[float]) -> list[float]:
    """Return the reduced model's flexible modes, one for each known one; none if it has no pair."""
    pairs = [mode for mode in response.modes if mode.kept and states_of(mode) > 1]
    if not pairs:
        return []
    return [
        min(pairs, key=lambda mode: abs(math.log(mode.frequency_hz / known))).frequency_hz
        for known in known_modes_hz
    ]


def versions() -> dict[str, str]:
    """Return the versions of what computed the results."""
    return {
        "python": platform.python_version(),
        "ros_distro": os.environ.get("ROS_DISTRO", "unknown"),
        **{name: version(name) for name in _VERSIONED},
    }
