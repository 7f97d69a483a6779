"""Claim 2-7: the same experiments at 300 and at 500 Hz."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.experiments.catalogue import catalogue, experiment
from reproduction.chapter2.easier_rigs import least_error
from reproduction.chapter2.order_survey import CUTOFF_HZ, best_error, prepared
from reproduction.chapter2.tables import METHOD_TEXT, PAIRS, survey_calls, survey_of
from reproduction.framework.findings import (
    SEEDS,
    Call,
    Finding,
    SideBySide,
    columns,
    prose,
    spread,
    subject,
)
from reproduction.framework.rig import run_experiment
from reproduction.framework.study_rig import study_rig
from reproduction.framework.verdicts import Judgement, judged, less, p_text, sign_test

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_daq import RigParameters
    from flexarm_daq.experiments.catalogue import Experiment
    from reproduction.framework.findings import Results

    Errors = Mapping[str, Sequence[float]]


_EVEN_SEEDS = SEEDS[:5]
_SLOW = {high: low for low, high in PAIRS.items()}


def evened(name: str) -> tuple[Experiment, RigParameters]:
    """Return a fast experiment as long as its slow one, and the rig with noise as dense for it.

    White noise that is sampled faster is thinner at each frequency.
    """
    slow, fast = experiment(_SLOW[name]), experiment(name)
    faster = fast.rate_hz / slow.rate_hz
    rig = study_rig()
    position, base, middle, speed = (math.sqrt(faster) * volts for volts in rig.noise_v)
    denser = replace(rig, noise_v=(position, base, middle, speed))
    return replace(fast, samples=round(slow.samples * faster)), denser


def even_error(name: str, seed: int) -> float:
    """Return the mean error of the best model from an experiment and rig of `evened`."""
    record = prepared(run_experiment(*evened(name), seed))
    return best_error(record, record)


def _rates(results: Results) -> Finding:
    low = {name: survey_of(results, name).mean_dmv.tolist() for name in PAIRS}
    high = {name: survey_of(results, other).mean_dmv.tolist() for name, other in PAIRS.items()}
    quiet = {
        name: tuple(results[Call(least_error, (each, 1, False, True))] for each in (name, other))
        for name, other in PAIRS.items()
    }
    even = {
        name: [results[Call(even_error, (other, seed))] for seed in _EVEN_SEEDS]
        for name, other in PAIRS.items()
    }
    rows = tuple(
        (
            f"{name}, {other}",
            f"{catalogue()[name].waveform.replace('_', ' ')} {catalogue()[name].magnitude_v:g} V",
            spread(low[name]),
            spread(high[name]),
            *(f"{each:.3f}" for each in quiet[name]),
            spread(even[name]),
        )
        for name, other in PAIRS.items()
    )
    headings = columns(prose("claim-2-7.columns"))
    return Finding(
        rate_judgement(low, high, list(quiet.values()), even),
        (SideBySide("Mean error of the same experiment at both rates", headings, rows),),
        text=(METHOD_TEXT,),
    )


def rate_judgement(
    low: Errors, high: Errors, quiet: Sequence[tuple[float, float]], even: Errors
) -> Judgement:
    """Judge the errors at 300 and 500 Hz, by pair and seed.

    Parameters
    ----------
    low, high, even : mapping of str to sequence of float
        Errors by the slow experiment's name, one per seed; `even` from `even_error`.
    quiet : sequence of tuple of float
        Both errors of each pair without noise.
    """
    means, high_means, even_means = (
        np.mean(list(errors.values()), axis=0) for errors in (low, high, even)
    )
    return judged(
        statements=(less("300 Hz give the smaller error", means, high_means),),
        evidence=f"Mean error over all pairs {np.median(means):.3f} at 300 Hz, "
        f"{np.median(high_means):.3f} at 500 Hz. 300 Hz is better in {_won(low, high)} of "
        f"{len(low)} pairs, without noise in {sum(a < b for a, b in quiet)}.",
        reason=prose(
            "claim-2-7.reason",
            cutoff_hz=CUTOFF_HZ,
            even=np.median(even_means),
            won=_won(low, even),
            pairs=len(low),
            p=p_text(sign_test(means[: len(even_means)], even_means)),
        ),
    )


def _won(low: Errors, high: Errors) -> int:
    """Count the pairs whose slow experiment has the smaller median."""
    return sum(bool(np.median(low[name]) < np.median(high[name])) for name in low)


SUBJECTS = (
    subject(
        "claim-2-7",
        (
            *survey_calls(*PAIRS, *PAIRS.values()),
            *(Call(least_error, (name, 1, False, True)) for name in (*PAIRS, *PAIRS.values())),
            *(Call(even_error, (name, seed)) for name in PAIRS.values() for seed in _EVEN_SEEDS),
        ),
        _rates,
    ),
)
