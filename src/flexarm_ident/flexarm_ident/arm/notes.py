"""Words on an arm with dry friction: its choice, its levels, and what its records do not tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit, with_deviation
from flexarm_ident.arm.equations import FrictionModel
from flexarm_ident.fitting.validation import mean_error

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.arm.fit import ArmFit
    from flexarm_ident.friction.levels import CoulombEstimate

# Half the range of a level, in units of its middle.
_UNDETERMINED = 0.1
# The same for what the level depends on, which matters less.
_VAGUE = 0.4
# Rounding of an eigenvalue that is one.
_INTEGRATOR = 1e-9
_SWEEPS = "record slow reversals and fast sweeps in one experiment"
_REVERSALS = "record many slow reversals, with rests between them"
_LOADS = "record strong accelerations beside gentle ones"
_MODELS = {
    FrictionModel.COULOMB: "Coulomb and viscous",
    FrictionModel.STRIBECK: "higher at standstill",
    FrictionModel.LOAD: "higher under load",
    FrictionModel.STRIBECK | FrictionModel.LOAD: "higher at standstill and under load",
}


def levels_text(coulomb: CoulombEstimate) -> str:
    """Return the levels with scatter and units: ``0.14 ± 0.02 A at current1``."""
    words = []
    for drive, level, deviation in zip(
        coulomb.drives, coulomb.levels, coulomb.deviations, strict=True
    ):
        name, unit = label_and_unit(drive.input)
        words.append(f"{with_deviation(level, deviation)} {unit}".rstrip() + f" at {name}")
    return ", ".join(words)


def choice(fit: ArmFit, start_error: FloatArray, linear: str) -> str:
    """Return why the arm is the model, and what was chosen among the linear models before."""
    return (
        f"an arm with dry friction, order {fit.model.nstates}, took the place of the linear model: "
        f"{mean_error(fit.error):.3g} in simulation instead of {mean_error(start_error):.3g}; "
        f"{_friction(fit)}; of the linear ones, {linear}"
    )


def _friction(fit: ArmFit) -> str:
    """Return what the friction depends on, and the errors on halves left out that say so."""
    errors = ", ".join(
        f"{np.linalg.norm(halves):.3g} {_MODELS[each]}" for each, halves in fit.left_out.items()
    )
    return (
        f"its friction is {_MODELS[fit.friction_model]}, by halves left out of the fit ({errors})"
    )


def notes(fit: ArmFit) -> tuple[str, ...]:
    """Return what was left out of the fit, and what the records do not determine, a line each."""
    dead = ", ".join(
        f"{name} in {count:.0f} samples"
        for name, count in zip(fit.model.output_labels, fit.dead_samples, strict=True)
        if count
    )
    lines = [f"dead sensors were left out of the fit: {dead}"] if dead else []
    for name, ranges in zip(fit.model.input_labels, fit.law_ranges, strict=True):
        lines += _undetermined(*label_and_unit(name), ranges)
    names = ", ".join(label_and_unit(fit.model.input_labels[hub])[0] for hub in fit.free_hubs)
    if names:
        lines.append(f"no stiffness holds what {names} drives: the model integrates there")
    return (*lines, *_growth(fit))


def _undetermined(title: str, unit: str, ranges: FloatArray) -> Iterator[str]:
    """Yield what the records do not determine of one input's law, (figures, 2)."""
    level, rise, _, load, held = ranges
    at_rest = f", {_span(held, unit)} with the rise at standstill" if rise[1] > 0.0 else ""
    for what, own, limit, of, beside, remedy in (
        (f"friction level of {title}", level, _UNDETERMINED, unit, at_rest, _SWEEPS),
        (f"rise of the friction of {title} at standstill", rise, _VAGUE, unit, "", _REVERSALS),
        (f"part of the load in the friction of {title}", load, _VAGUE, "", "", _LOADS),
    ):
        if own[1] - own[0] > limit * (own[1] + own[0]):
            yield (
                f"the {what} is not determined by the record: {_span(own, of)} simulate it "
                f"equally well{beside}; {remedy}"
            )


def _span(ends: FloatArray, unit: str) -> str:
    return f"{ends[0]:.3g} to {ends[1]:.3g} {unit}".rstrip()


def _growth(fit: ArmFit) -> list[str]:
    """Return that the model's free motion grows, in a list; an empty list when it does not."""
    largest = float(np.abs(np.linalg.eigvals(fit.model.A)).max())
    if largest <= 1.0 + _INTEGRATOR:
        return []
    constant_s = fit.model.dt / np.log(largest)
    line = (
        f"the arm's free motion grows, with a time constant of {constant_s:.2g} s (an eigenvalue "
        f"of {largest:.6f}): simulate it no longer than its records"
    )
    return [line]
