"""Simulation of a law in its loop, without nodes: on a rig, or on a linear model of the arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.switching import Handover
from flexarm_control.models.arm_model import check_arm_model, check_no_feedthrough
from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.labels import axis_label
from flexarm_core.showing.tables import html_table
from flexarm_core.showing.traces import Panel, plot_traces
from flexarm_core.signals import RigSample

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control
    from numpy.typing import NDArray

    from flexarm_control.laws.law_protocol import Effort, Law, LawWithMemory
    from flexarm_core.arrays import FloatArray


class Rig(Protocol):
    """Rig of a simulation, such as `flexarm_daq.SimulatedRig`."""

    def open(self) -> None:
        """Open the rig, with the drive at zero."""

    def read(self) -> RigSample:
        """Sample position, base strain, middle strain and speed, V."""

    def write(self, commands: Sequence[float], /) -> None:
        """Command the drive, V."""


@dataclass(frozen=True, repr=False)
class LoopRun:
    """Signals of one simulated run.

    Attributes
    ----------
    time_s : ndarray, (samples,)
        Sample instants, s.
    y : ndarray, (samples, 4)
        Position, base strain, middle strain and speed, V.
    effort, compensation, reference_v : ndarray, (samples,)
        Feedback effort u_e, Coulomb friction compensation u_c and position reference, V.
    true_y : ndarray, (samples, 4)
        Outputs as `y`, without noise and converters; (samples, 0) where they are unknown.
    """

    time_s: FloatArray
    y: FloatArray
    effort: FloatArray
    compensation: FloatArray
    reference_v: FloatArray
    true_y: FloatArray

    @property
    def command_v(self) -> FloatArray:
        """Command of the drive (4-6), V, (samples,)."""
        return self.effort + self.compensation

    def __repr__(self) -> str:
        figures = ", ".join(f"{name} {figure}" for name, figure in self._figures)
        return f"<{type(self).__name__} {len(self.time_s)} samples; {figures}>"

    def _repr_html_(self) -> str:
        return html_table(f"{len(self.time_s)} samples", ("figure", "value"), self._figures)

    def plot_run(self) -> NDArray[np.object_]:
        """Plot position with its reference, strains, speed, and the command.

        Returns
        -------
        ndarray of matplotlib.axes.Axes, (5,)
            The axes.
        """
        outputs = [
            Panel(axis_label(name), [("", values)])
            for name, values in zip(CHANNEL_NAMES, self.y.T, strict=True)
        ]
        position = [("position", self.y[:, 0]), ("reference", self.reference_v)]
        panels = [Panel("position, V", position), *outputs[1:]]
        return plot_traces(self.time_s, [*panels, Panel("command, V", [("", self.command_v)])])

    @property
    def _figures(self) -> list[tuple[str, str]]:
        """Return the figures of a step where the reference is one, else of the error alone."""
        hub_v, end_v = self.y[:, 0], float(self.reference_v[-1])
        if np.any(self.reference_v != end_v):
            return [("RMS error", f"{np.sqrt(np.mean((self.reference_v - hub_v) ** 2)):.3f} V")]
        step = step_figures(self.time_s, hub_v, end_v)
        return [
            ("set-point", f"{end_v:g} V"),
            ("mean error", f"{step.mean_error_v:+.4f} V"),
            ("overshoot", f"{step.overshoot:.1%}"),
            ("settling time (5 %)", f"{step.settling_s:.2f} s"),
            ("rise time", f"{step.rise_s:.2f} s"),
        ]


def simulate(
    rig: Rig,
    law: Law,
    reference_v: FloatArray,
    *,
    acting_v: Callable[[Effort], float] = sum,
    true_outputs: Callable[[], FloatArray] | None = None,
) -> LoopRun:
    """Run a law on a rig from rest, each command acting at the sample that it answers.

    Parameters
    ----------
    rig : Rig
        Rig; it is opened first.
    law : Law
        Law; it is reset first.
    reference_v : ndarray, (samples,)
        Reference at every sample, V.
    acting_v : callable
        Command of the drive for an answer of the law, V, which the law hears; by default the sum of
        its parts (4-6).
    true_outputs : callable, optional
        Function that returns the outputs without noise, V, (4,); called after every reading.

    Returns
    -------
    LoopRun
        Signals at every sample.

    Raises
    ------
    FlexarmError
        When the rig cannot be opened, read or written.
    """

    def acting(answer: Effort) -> DriveCommand:
        return DriveCommand(acting_v(answer), answer.compensation_v)

    return _run(rig, law, reference_v, acting, true_outputs)


def _run(
    rig: Rig,
    law: Law,
    reference_v: FloatArray,
    acting: Callable[[Effort], DriveCommand],
    true_outputs: Callable[[], FloatArray] | None = None,
) -> LoopRun:
    """Run a law on a rig; see `simulate`."""
    samples = len(reference_v)
    time_s, y, answers = np.empty(samples), np.empty((samples, 4)), np.empty((samples, 2))
    true_y = np.empty((samples, 0 if true_outputs is None else 4))
    rig.open()
    law.reset()
    # Nobody asks for its memory.
    loop, drive = Handover(cast("LawWithMemory", law)), None
    for k, reference in enumerate(np.asarray(reference_v, dtype=float).tolist()):
        sample = rig.read()
        time_s[k], y[k] = sample.time_s, sample.outputs
        if true_outputs is not None:
            true_y[k] = true_outputs()
        answers[k] = answer = loop.step(y[k].tolist(), reference, drive)
        drive = acting(answer)
        rig.write([drive.command_v])
    reference_v = np.asarray(reference_v, dtype=float)
    return LoopRun(time_s, y, answers[:, 0], answers[:, 1], reference_v, true_y)


class _ModelRig:
    """Linear model of the arm, at rest when it is opened."""

    def __init__(self, model: control.StateSpace, disturbance_v: float) -> None:
        self._dt_s = float(model.dt)
        self._disturbance_v = disturbance_v
        self._a, self._c = np.asarray(model.A), np.asarray(model.C)
        self._b = np.asarray(model.B)[:, 0]

    def open(self) -> None:
        self._samples = 0
        self._state = np.zeros(len(self._a))

    def read(self) -> RigSample:
        return RigSample(self._dt_s * self._samples, self._c @ self._state)

    def write(self, commands: Sequence[float]) -> None:
        self._samples += 1
        self._state = self._a @ self._state + self._b * (commands[0] + self._disturbance_v)


def simulate_loop(
    model: control.StateSpace, law: Law, reference_v: FloatArray, *, disturbance_v: float = 0.0
) -> LoopRun:
    """Run a law on a model from rest, sample by sample.

    The input of the model is the feedback effort alone. The models of the thesis have no friction
    (section 2.4.3). The compensation, which cancels it on the arm, is recorded but does not act.

    Parameters
    ----------
    model : control.StateSpace
        Model of the arm; `flexarm_control.models.arm_model.delayed` gives it a loop delay.
    law : Law
        Law; it is reset first.
    reference_v : ndarray, (samples,)
        Reference at every sample, V.
    disturbance_v : float
        Constant added to the command, V: d of Figure 4-14.

    Returns
    -------
    LoopRun
        Signals at every sample.

    Raises
    ------
    SettingError
        When the model is not one of the arm or its D is not zero.
    """
    check_arm_model(model)
    check_no_feedthrough(model)

    def acting(answer: Effort) -> DriveCommand:
        return DriveCommand(answer.effort_v, 0.0)

    return _run(_ModelRig(model, disturbance_v), law, reference_v, acting)
