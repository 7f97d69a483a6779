"""Certificate of a tuning in words: what was searched, and how sure the result is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.search import gain_values
from flexarm_control.design.tuning import PI_BOUNDS
from flexarm_control.laws.gains import CompensationLevel
from flexarm_control.models.arm_model import MIDDLE_STRAIN, OUTPUTS, POSITION, SPEED

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from flexarm_control.design.requirements import Requirements
    from flexarm_control.design.tuning import PdpTuning, PiTuning

# Largest difference of gains of one minimum, V/V.
_SPREAD = 0.05
# Part of J below which a difference is none that a step on the arm would show.
_SAME = 0.01
_FED_BACK = {OUTPUTS[SPEED]: "kd", OUTPUTS[MIDDLE_STRAIN]: "ksg"}
"""Gains of (4-7) by the outputs that they feed back."""


def starts_agree(found: PdpTuning) -> bool:
    """Return whether all starts that met the constraints ended at the same gains."""
    return found.gain_spread <= _SPREAD


def confirmation(found: PdpTuning) -> str:
    """Return in words whether the starts confirm each other, and what to do if not."""
    feasible = [search for search in found.searches if search.feasible]
    starts = f"{len(feasible)} of {len(found.searches)} starts met the constraints"
    if len(feasible) == 1:
        return f"{starts}: no other start confirms the gains, so try them on the arm with care"
    if starts_agree(found):
        return f"{starts} and agree; gains differ by at most {found.gain_spread:.3g}"
    spread = f"{starts} and do NOT agree: gains differ by up to {found.gain_spread:.3g}"
    best = gain_values(found.gains)
    others = [each for each in feasible if np.max(np.abs(gain_values(each.gains) - best)) > _SPREAD]
    if (same := len(feasible) - len(others)) > 1:
        worst = max(each.criterion for each in others) / found.criterion - 1.0
        return (
            f"{spread}; {same} end at these, the others at a J up to {100 * worst:.0f} % larger. "
            "The models leave out friction: compare its step with that of the default gains"
        )
    if any(each.criterion <= (1.0 + _SAME) * found.criterion for each in others):
        return (
            f"{spread}, and others have the same J within {100 * _SAME:.0f} %, which hardly "
            "depends on the gains: compare steps on the arm, or tune on several payloads together"
        )
    return (
        f"{spread}; the best is written, and no other start confirms it. Compare its step with "
        "that of the default gains, or tune on several payloads together"
    )


def at_bounds(active: Sequence[str]) -> list[str]:
    """Return the bounds of gains among what is active."""
    return [each for each in active if each.startswith("bound of ")]


def stopped_by(active: Sequence[str]) -> str:
    """Return in words what stopped the search, with what to do at a bound."""
    text = f"active: {', '.join(active) or 'none'}"
    if at_bounds(active):
        text += (
            "; the best gain may lie beyond: see that all signals are in V, or weigh E and Y anew"
        )
    return text


def pi_stopped_by(found: PiTuning) -> str:
    """Return in words what stopped the search of the PI law, with what to do at a bound."""
    text = f"active: {', '.join(found.active) or 'none'}"
    if not found.active:
        return text
    if np.isclose(found.gains.ki, PI_BOUNDS[1][0]):
        return f"{text}; the step needs no integral: next to 0, ki leaves a proportional law"
    return f"{text}; the best gain may lie beyond: see that all signals are in V"


def no_position(model: str) -> str:
    """Return why a model is not a model to tune on."""
    return (
        f"{model}: the input does not move {OUTPUTS[POSITION]}: there is nothing to control; "
        "identify from a record in which the hub moves"
    )


def of_unreached(model: str, outputs: Sequence[str], gains: Collection[str]) -> str:
    """Return what a tuning is worth where the input does not reach some outputs.

    Parameters
    ----------
    model : str
        Name of the model.
    outputs : sequence of str
        Outputs that the input does not reach.
    gains : collection of str
        Names of the gains that were tuned.
    """
    idle = [gain for name, gain in _FED_BACK.items() if name in outputs and gain in gains]
    worth = f"; {' and '.join(idle)} act on nothing there: set them to 0" if idle else ""
    return (
        f"caution: the input does not reach {', '.join(outputs)} of {model}, channels that its rig "
        f"seems to lack: nothing here is known of them{worth}"
    )


def compensated(law: str) -> str:
    """Return how much friction a law makes up for where the models tell none."""
    return (
        f"{law}.compensation_v is {CompensationLevel().compensation_v:g} V, the friction of the "
        "thesis's arm: for another arm, set it to the level that identify finds, or to 0"
    )


def handed_over(law: str, level_v: float, model: str) -> str:
    """Return where the level of a law's compensation comes from."""
    return f"{law}.compensation_v is {level_v:.3g} V, the friction that identify found in {model}"


def explained(wanted: Requirements) -> tuple[str, ...]:
    """Return what E, Y and J are."""
    return (
        "E: time-weighted error of the position (4-4), Y: of both gauges (4-5), s^2, steps of 1 V",
        f"J: {wanted.error_weight:g} sum E + {wanted.strain_weight:g} sum Y (4-3), best smallest",
        f"least margins: {wanted.gain_margin_db:g} dB, {wanted.phase_margin_deg:g} deg each model",
    )


def searched(names: Sequence[str], bounds: Sequence[tuple[float, float]]) -> str:
    """Return between which bounds gains were searched."""
    ranges = zip(names, bounds, strict=True)
    return f"searched: {', '.join(f'{name} {low:g} to {high:g}' for name, (low, high) in ranges)}"
