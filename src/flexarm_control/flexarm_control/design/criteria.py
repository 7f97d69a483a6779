"""Figures of merit of a run: ITAE criteria and the figures of a step response."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isnan
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from flexarm_core.arrays import RealArray

_MEAN_WINDOW_S = 2.0
_SETTLING_BAND = 0.05
_RISE = (0.1, 0.9)
_STRAIN_BAND = 0.1
# The vibrations of the arm are slower, and noise is averaged out.
_SMOOTHED_S = 0.03
_ABOVE_NOISE = 4.0
# Median of the magnitude of a normal variable with deviation one.
_NORMAL_MEDIAN = 0.6745


def itae(error: RealArray, *, dt_s: float) -> float:
    """Return the integral of time-multiplied absolute error (4-1), dt sum t(k) |e(k)|.

    Parameters
    ----------
    error : ndarray, (samples,)
        Error, the first sample at time zero.
    dt_s : float
        Sampling period, s.

    Returns
    -------
    float
        Integral, in the unit of the error times s^2.
    """
    time_s = dt_s * np.arange(len(error))
    return float(dt_s * time_s @ np.abs(error))


def position_itae(position_v: RealArray, reference_v: float, *, dt_s: float) -> float:
    """Return the ITAE of the position error normalised by the set-point (4-4), s^2.

    Parameters
    ----------
    position_v : ndarray, (samples,)
        Position after a step of the reference at time zero, V.
    reference_v, dt_s : float
        Set-point R, V, and sampling period, s.
    """
    return itae((reference_v - position_v) / reference_v, dt_s=dt_s)


def strain_itae(base_strain_v: RealArray, middle_strain_v: RealArray, *, dt_s: float) -> float:
    """Return the ITAE of both strain signals, each normalised by its own peak (4-5), s^2.

    Parameters
    ----------
    base_strain_v, middle_strain_v : ndarray, (samples,)
        Strain signals after a step of the reference at time zero, V. A signal that is zero
        throughout counts as zero.
    dt_s : float
        Sampling period, s.
    """
    total = 0.0
    for strain_v in (base_strain_v, middle_strain_v):
        peak_v = float(np.max(np.abs(strain_v)))
        total += itae(strain_v / peak_v, dt_s=dt_s) if peak_v > 0.0 else 0.0
    return total


def step_itae(y: RealArray, *, dt_s: float) -> tuple[float, float]:
    """Return E of (4-4) and Y of (4-5), s^2, of a response to a step of 1 V.

    Parameters
    ----------
    y : ndarray, (samples, 4)
        Position, base strain, middle strain and speed, V, the first sample at the step.
    dt_s : float
        Sampling period, s.
    """
    position_v, base_strain_v, middle_strain_v, _ = y.T
    return (
        position_itae(position_v, 1.0, dt_s=dt_s),
        strain_itae(base_strain_v, middle_strain_v, dt_s=dt_s),
    )


def strain_settling_s(strain_v: RealArray, *, dt_s: float) -> float:
    """Return the time from which a strain stays within a tenth of its peak, s.

    It is infinite when the last sample is outside. The strain is averaged over 0.03 s; what does
    not stand out of its noise then is inside.

    Parameters
    ----------
    strain_v : ndarray, (samples,)
        Strain signal, the first sample at the step, V.
    dt_s : float
        Sampling period, s.
    """
    width = max(1, round(_SMOOTHED_S / dt_s))
    smooth_v = np.convolve(strain_v, np.full(width, 1.0 / width), mode="same")
    # Two differences leave little of a vibration; those of white noise have six times its power.
    noise_v = float(np.median(np.abs(np.diff(strain_v, 2)))) / (_NORMAL_MEDIAN * np.sqrt(6.0))
    floor_v = _ABOVE_NOISE * noise_v / np.sqrt(width)
    band_v = max(_STRAIN_BAND * float(np.max(np.abs(smooth_v))), floor_v)
    outside = np.flatnonzero(np.abs(smooth_v) > band_v)
    if len(outside) == 0:
        return 0.0
    first_inside = int(outside[-1]) + 1
    return dt_s * first_inside if first_inside < len(smooth_v) else inf


@dataclass(frozen=True)
class StepFigures:
    """Figures of one step response.

    Attributes
    ----------
    mean_error_v : float
        Mean of reference minus position over the last 2 s, or over a shorter record, V.
    overshoot : float
        Largest excess over the reference as a fraction of the step, 0 for none.
    settling_s : float
        Time from which the position stays within 5 % of the step around the reference, s; infinite
        when the last sample is outside.
    rise_s : float
        Time between the first samples beyond 10 % and 90 % of the step, s; infinite when the
        position does not reach 90 %.
    """

    mean_error_v: float
    overshoot: float
    settling_s: float
    rise_s: float

    def __str__(self) -> str:
        figures = ", ".join(f"{name}={value:.4g}" for name, value in vars(self).items())
        return f"StepFigures({figures})"


def step_figures(
    time_s: RealArray, position_v: RealArray, reference_v: float, start_v: float = 0.0
) -> StepFigures:
    """Return the figures of a step response that starts with the first sample.

    Parameters
    ----------
    time_s, position_v : ndarray, (samples,)
        Sample instants, s, increasing, and position, V.
    reference_v, start_v : float
        Set-point, and position before the step, V.

    Raises
    ------
    SettingError
        When there is no sample, the lengths differ, or the step has no height.
    """
    if len(time_s) == 0 or np.shape(time_s) != np.shape(position_v):
        raise SettingError(
            f"a step response needs one time per position; got {np.shape(time_s)} times and "
            f"{np.shape(position_v)} positions"
        )
    if reference_v == start_v:
        raise SettingError(f"no step: reference_v and start_v are both {start_v:g} V")
    since_step_s = time_s - time_s[0]
    progress = (position_v - start_v) / (reference_v - start_v)
    last = since_step_s >= since_step_s[-1] - _MEAN_WINDOW_S
    mean_error_v = float(np.mean(reference_v - position_v[last]))
    return StepFigures(mean_error_v, *unit_step_figures(since_step_s, progress, _SETTLING_BAND))


def unit_step_figures(
    since_step_s: RealArray, progress: RealArray, band: float
) -> tuple[float, float, float]:
    """Return overshoot, settling and rise time of a step from 0 to 1, by python-control.

    Its `step_info` raises an IndexError for a step that does not reach 90 %, and has NaN where ours
    are infinite.

    Parameters
    ----------
    since_step_s, progress : ndarray, (samples,)
        Time since the step, s, and the part of it that is done.
    band : float
        Part of the step within which it has settled, below a tenth.
    """
    # Written so that NaN has not risen either.
    if not np.max(progress) >= _RISE[1]:
        return 0.0, inf, inf
    from flexarm_ident.models.control_library import control_library  # noqa: PLC0415 - seldom used

    found = control_library().step_info(
        progress, since_step_s, final_output=1.0, SettlingTimeThreshold=band, RiseTimeLimits=_RISE
    )
    settling_s = found["SettlingTime"]
    overshoot = found["Overshoot"] / 100.0
    return overshoot, inf if isnan(settling_s) else settling_s, found["RiseTime"]
