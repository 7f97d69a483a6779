"""Validation of a model: data matching (DMV) and set-point following (SFV), section 2.4."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.channels import CHANNEL_NAMES, MAX_COMMAND_V
from flexarm_core.clock import SAME_PERIOD
from flexarm_core.errors import IdentificationError
from flexarm_core.labels import axis_label
from flexarm_core.showing.traces import Panel, plot_traces
from flexarm_ident.fitting.output_fit import fit_initial_states
from flexarm_ident.models.state_space import BlockSimulation, simulate
from flexarm_ident.records.preprocess import remove_compensation

if TYPE_CHECKING:
    import control
    from numpy.typing import ArrayLike, NDArray

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.records.iodata import IoData

_NUMBERED = re.compile(r"[uy]\[\d+\]")
LAW_OUTPUTS = tuple(CHANNEL_NAMES[each] for each in (0, 3, 2))
_LAW_RESIDUAL = 1e-6
# Share of the rows that a law must explain, and the reweightings that find it.
_LAW_SHARE = 0.9
_LAW_ITERATIONS = 30
_FREQUENCIES_AT_ONCE = 512


@dataclass(frozen=True, eq=False, repr=False)
class Dmv:
    """Data matching validation: the model driven by the measured input.

    Attributes
    ----------
    delta : ndarray, (outputs,)
        Error of each output relative to its RMS about zero (2-25), which an offset flatters; NaN
        for a constant output.
    mean : float
        Mean of `delta` over the other outputs.
    error : ndarray, (outputs,)
        The same relative to the deviation about the mean, the NRMSE.
    y : ndarray, (samples, outputs)
        Simulated outputs.
    x0 : ndarray, (states,)
        Initial state of the simulation.
    """

    delta: FloatArray
    mean: float
    error: FloatArray
    y: FloatArray
    x0: FloatArray

    def __repr__(self) -> str:
        errors = " ".join(f"{error:.3f}" for error in self.error)
        return f"<{type(self).__name__} mean {mean_error(self.error):.3f}, outputs {errors}>"

    def plot_match(self, data: IoData) -> NDArray[np.object_]:
        """Plot the simulated outputs over the measured ones, as Figures 2-7 and 2-8 do.

        Parameters
        ----------
        data : IoData
            The record that was simulated.

        Returns
        -------
        ndarray of matplotlib.axes.Axes, (outputs,)
        """
        panels = [
            Panel(axis_label(name), [("measured", measured), ("simulated", simulated)])
            for name, measured, simulated in zip(
                data.outputs, data.y_measured.T, self.y.T, strict=True
            )
        ]
        return plot_traces(data.times_s, panels)


@dataclass(frozen=True)
class Gains:
    """A linear law ``u = kp (R - y1) - kd y4 - ksg y3 + offset_v`` (Figure 2-3, (4-6), (4-7)).

    Attributes
    ----------
    kp, kd, ksg : float
        Gains on position error, speed and middle strain.
    offset_v : float
        Constant part, left by biases that were removed from the record.
    """

    kp: float
    kd: float
    ksg: float = 0.0
    offset_v: float = 0.0


@dataclass(frozen=True, eq=False)
class Sfv:
    """Set-point following validation: the model under the experiment's own control law.

    Attributes
    ----------
    delta, mean, error
        As of `Dmv`.
    y : ndarray, (samples, outputs)
        Outputs of the closed loop with the model.
    gains : Gains
        The law.
    """

    delta: FloatArray
    mean: float
    error: FloatArray
    y: FloatArray
    gains: Gains


def rms(measured: FloatArray) -> FloatArray:
    """Return the RMS of each output, (samples, outputs) to (outputs,); NaN does not count."""
    return np.asarray(np.sqrt(np.mean(measured**2, axis=0, where=~np.isnan(measured))))


def relative_errors(measured: FloatArray, simulated: FloatArray) -> FloatArray:
    """Return delta of each output (2-24), (2-25).

    Parameters
    ----------
    measured, simulated : ndarray, (samples, outputs)
        Outputs; what is NaN in `measured` does not count.

    Returns
    -------
    ndarray, (outputs,)
        RMS error over RMS output; NaN for a constant output, of which nothing can be matched.
    """
    # Sums along a row are fast.
    by_output = np.ascontiguousarray(measured.T)
    # Both ignore NaN.
    varies = np.fmax.reduce(by_output, axis=1) > np.fmin.reduce(by_output, axis=1)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        missed = by_output - simulated.T
        unknown = np.isnan(by_output)
        if unknown.any():
            by_output = np.where(unknown, 0.0, by_output)
            missed[unknown] = 0.0
        delta = np.sqrt(np.sum(missed**2, axis=1) / np.sum(by_output**2, axis=1))
    return np.where(varies, np.where(np.isfinite(delta), delta, np.inf), np.nan)


def about_mean(errors: FloatArray, measured: FloatArray) -> FloatArray:
    """Return errors (2-25), (outputs,), relative to the deviation about the mean instead of zero.

    An offset of the `measured` outputs, (samples, outputs), is there with any model and would
    flatter them.
    """
    known = ~np.isnan(measured)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        mean = np.mean(measured, axis=0, where=known)
        deviation = rms(measured - mean)
        return np.asarray(errors * np.hypot(mean, deviation) / deviation)


def fit_percent(measured: FloatArray, simulated: FloatArray) -> FloatArray:
    """Return the fit of each output, 100 (1 - NRMSE) with the mean removed, (outputs,).

    It is 100 for a perfect model and 0 for one that gives the output's mean. NaN in `measured` does
    not count, and a constant output has none.
    Ljung, "System Identification Toolbox", `compare`.
    """
    known = ~np.isnan(measured)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        centred = measured - np.mean(measured, axis=0, where=known)
        missed, level = (
            np.sqrt(np.mean(each**2, axis=0, where=known))
            for each in (measured - simulated, centred)
        )
        fit = 100.0 * (1.0 - missed / np.where(level > 0.0, level, np.nan))
    return np.asarray(np.where(np.isnan(missed) & (level > 0.0), -np.inf, fit))


def mean_error(errors: FloatArray) -> float:
    """Return the mean of relative errors, (outputs,), over the outputs that have one."""
    known = errors[~np.isnan(errors)]
    return float(known.mean()) if len(known) else np.nan


def validate_dmv(model: control.StateSpace, data: IoData, x0: ArrayLike | None = None) -> Dmv:
    """Compare measured outputs with a free simulation, without dry friction, under their input.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    data : IoData
        Record, in the thesis twice as long as the part that was identified.
    x0 : array_like, (states,), optional
        Initial state; by default fitted to the whole record by least squares.

    Returns
    -------
    Dmv
        Errors and simulated outputs.

    Raises
    ------
    IdentificationError
        If model and record differ in channels or sampling period.
    """
    check_model(model, data)
    start = _initial_state(model, data) if x0 is None else _checked_state(model, x0)
    y = simulate(model, data.u, start)
    delta = relative_errors(data.y_measured, y)
    return Dmv(delta, mean_error(delta), about_mean(delta, data.y_measured), y, start)


def validate_sfv(
    model: control.StateSpace,
    data: IoData,
    gains: Gains | None = None,
    x0: ArrayLike | None = None,
) -> Sfv:
    """Compare measured outputs with the model in closed loop on the recorded reference.

    The law answers sample k before sample k + 1, without Coulomb compensation and without
    saturation (Figure 2-3).

    Parameters
    ----------
    model : control.StateSpace
        Discrete model without feedthrough.
    data : IoData
        Closed-loop record with its reference.
    gains : Gains, optional
        The law; by default recovered from the record.
    x0 : array_like, (states,), optional
        Initial state; by default that of `validate_dmv` under the effort alone.

    Returns
    -------
    Sfv
        Errors, outputs and the law.

    Raises
    ------
    IdentificationError
        If the record has no reference, no linear law made its input, or the model does not fit.
    """
    check_model(model, data)
    if data.reference is None or data.reference.ndim > 1:
        raise IdentificationError(f"{data.label}: SFV needs the recorded reference of one output")
    law = gains or recover_gains(data)
    if law is None:
        raise IdentificationError(
            f"{data.label}: no linear law of position, speed and middle strain made the recorded "
            "effort: give the gains, or validate with DMV only"
        )
    if np.any(model.D):
        raise IdentificationError("SFV needs a model without feedthrough (D = 0)")
    feedback = np.zeros((1, model.noutputs))
    for name, gain in zip(LAW_OUTPUTS, (law.kp, law.kd, law.ksg), strict=True):
        if gain != 0.0:
            feedback[0, data.outputs.index(name)] = gain
    A = model.A - model.B @ feedback @ model.C
    effort = remove_compensation(data)
    start = _initial_state(model, effort) if x0 is None else _checked_state(model, x0)
    drive = (law.kp * data.reference + law.offset_v)[:, np.newaxis]
    y = BlockSimulation(A, model.B, model.C, model.D, start).advance(drive)
    delta = relative_errors(data.y_measured, y)
    return Sfv(delta, mean_error(delta), about_mean(delta, data.y_measured), y, law)


def recover_gains(data: IoData, *, limit_v: float = MAX_COMMAND_V) -> Gains | None:
    """Recover the linear law that made the recorded effort, by least absolute deviations.

    The effort is recorded without loss and answers the sample in its own row, so a PD or PDP law
    fits to rounding. Rows in which the drive saturates are left out. A few unanswered samples in
    real time, which kept the effort before, do no harm.

    Parameters
    ----------
    data : IoData
        Closed-loop record with its reference.
    limit_v : float
        Magnitude of the input from which the drive saturates.

    Returns
    -------
    Gains or None
        The law; None when the record has no reference, lacks one of the outputs, or its effort does
        not come from such a law.
    """
    if data.reference is None or data.reference.ndim > 1 or data.u.shape[1] != 1:
        return None
    if not set(LAW_OUTPUTS) <= set(data.outputs):
        return None
    position, speed, strain = (data.y[:, data.outputs.index(name)] for name in LAW_OUTPUTS)
    free = (np.abs(data.u[:, 0]) < limit_v) & ~np.isnan(data.y_measured).any(axis=1)
    columns = [data.reference - position, -speed, -strain, np.ones(len(data))]
    regressors, effort = np.stack(columns, axis=1)[free], data.effort[free, 0]
    if len(effort) <= len(columns):
        return None
    scale = np.linalg.norm(regressors, axis=0)
    scale[scale == 0.0] = 1.0
    tolerance = _LAW_RESIDUAL * np.abs(effort).max()
    weight = np.ones(len(effort))
    for _ in range(_LAW_ITERATIONS):
        weighted = (regressors / scale) * weight[:, np.newaxis]
        solution = np.linalg.lstsq(weighted, effort * weight, rcond=None)[0] / scale
        residual = np.abs(effort - regressors @ solution)
        weight = 1.0 / np.sqrt(np.maximum(residual, tolerance))
    if np.mean(residual <= tolerance) < _LAW_SHARE:
        return None
    return Gains(*(float(gain) for gain in solution))


def frequency_response(model: control.StateSpace, frequencies_hz: ArrayLike) -> ComplexArray:
    """Return the gains of a discrete model, (frequencies, outputs, inputs): (2-4) with e^{+j w dt}.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    frequencies_hz : array_like, (frequencies,)
        Frequencies.
    """
    z = np.exp(2j * np.pi * np.asarray(frequencies_hz, dtype=np.float64) * model.dt)
    eye = np.eye(model.nstates)
    # Portions save memory: a large model has one large resolvent per frequency.
    parts = [
        model.C @ np.linalg.solve(part[:, np.newaxis, np.newaxis] * eye - model.A, model.B)
        for part in np.array_split(z, 1 + len(z) // _FREQUENCIES_AT_ONCE)
    ]
    return np.asarray(np.concatenate(parts) + model.D)


def _initial_state(model: control.StateSpace, data: IoData) -> FloatArray:
    return fit_initial_states(model, [data])[0]


def _checked_state(model: control.StateSpace, x0: ArrayLike) -> FloatArray:
    if len(start := np.asarray(x0, dtype=np.float64).ravel()) != model.nstates:
        raise IdentificationError(f"x0 has {len(start)} states, the model has {model.nstates}")
    return start


def check_model(model: control.StateSpace, data: IoData) -> None:
    """Raise an IdentificationError if model and record differ in channels or sampling period."""
    if (model.ninputs, model.noutputs) != (data.u.shape[1], data.y.shape[1]):
        raise IdentificationError(
            f"{data.label}: the model has {model.ninputs} inputs and {model.noutputs} outputs, "
            f"the record {data.u.shape[1]} and {data.y.shape[1]}"
        )
    for kind, own, labels in (
        ("inputs", model.input_labels, data.inputs),
        ("outputs", model.output_labels, data.outputs),
    ):
        # Names by number are those of a model without names.
        if tuple(own) != tuple(labels) and not all(map(_NUMBERED.fullmatch, own)):
            raise IdentificationError(
                f"{data.label}: its {kind} are {', '.join(labels)}, the model's {', '.join(own)}"
            )
    if not np.isclose(model.dt, data.dt_s, rtol=SAME_PERIOD, atol=0.0):
        raise IdentificationError(
            f"{data.label}: the model's period is {model.dt} s, the record's {data.dt_s} s"
        )
