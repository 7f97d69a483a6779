"""Weights and margins that a tuning is asked for, checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.design.margins import Margins
    from flexarm_core.arrays import FloatArray

# Largest margins in the search, whose arithmetic needs finite numbers.
_MOST_DB, _MOST_DEG = 60.0, 180.0
# A longer delay adds many states to the models, and no loop of the arm is stable with it.
_MOST_DELAY_S = 0.05
_MOST_DURATION_S = 60.0
_ACTIVE_WITHIN_DB, _ACTIVE_WITHIN_DEG = 0.1, 0.5


@dataclass(frozen=True)
class Requirements:
    """Criterion (4-3) and least margins of a tuning over several models.

    Attributes
    ----------
    error_weight, strain_weight : float
        W_E and W_sg of (4-3), not both zero.
    gain_margin_db, phase_margin_deg : float
        Least margins on every model, above 0 and at most 60 dB and below 180 deg.
    duration_s : float
        Length of the step of the criterion, above 0 and at most 60 s.

    Raises
    ------
    SettingError
        When a value is out of its range.
    """

    error_weight: float = 0.5
    strain_weight: float = 0.5
    gain_margin_db: float = 10.0
    phase_margin_deg: float = 55.0
    duration_s: float = 5.0

    def __post_init__(self) -> None:
        for name in ("error_weight", "strain_weight"):
            if not 0.0 <= (weight := getattr(self, name)) < np.inf:
                raise SettingError(f"{name} = {weight:g}; must be finite and not negative")
        if self.error_weight == self.strain_weight == 0.0:
            raise SettingError("error_weight = 0 and strain_weight = 0; one must be above 0")
        if not 0.0 < self.gain_margin_db <= _MOST_DB:
            raise SettingError(
                f"gain_margin_db = {self.gain_margin_db:g} dB; must be above 0 and at most "
                f"{_MOST_DB:g} dB"
            )
        if not 0.0 < self.phase_margin_deg < _MOST_DEG:
            raise SettingError(
                f"phase_margin_deg = {self.phase_margin_deg:g} deg; must be above 0 and below"
                f" {_MOST_DEG:g} deg"
            )
        check_duration(self.duration_s)

    def criterion(self, parts: FloatArray) -> float:
        """Return J of (4-3) for E and Y of every model, (models, 2)."""
        errors, strains = parts.sum(axis=0)
        return float(self.error_weight * errors + self.strain_weight * strains)

    def excess(self, found: Sequence[Margins]) -> FloatArray:
        """Return how far margins lie above the least ones, dB and then deg, (2 models,)."""
        gain = np.clip([m.gain_margin_db for m in found], -_MOST_DB, _MOST_DB)
        phase = np.clip([m.phase_margin_deg for m in found], -_MOST_DEG, _MOST_DEG)
        return np.concatenate([gain - self.gain_margin_db, phase - self.phase_margin_deg])

    def active(self, found: Sequence[Margins]) -> list[str]:
        """Return the margins that stop the search, in words."""
        active = []
        for number, margin in enumerate(found, start=1):
            if margin.gain_margin_db <= self.gain_margin_db + _ACTIVE_WITHIN_DB:
                active.append(f"gain margin of model {number}")
            if margin.phase_margin_deg <= self.phase_margin_deg + _ACTIVE_WITHIN_DEG:
                active.append(f"phase margin of model {number}")
        return active


def check_duration(duration_s: float) -> None:
    """Raise a SettingError for a length of the criterion's step that cannot be used, s."""
    if not 0.0 < duration_s <= _MOST_DURATION_S:
        raise SettingError(
            f"duration_s = {duration_s:g}; must be above 0 and at most {_MOST_DURATION_S:g} s"
        )


def check_delay(delay_s: float) -> None:
    """Refuse a loop delay that a tuning does not take.

    Raises
    ------
    SettingError
        When it is negative or above 0.05 s.
    """
    if not 0.0 <= delay_s <= _MOST_DELAY_S:
        raise SettingError(f"delay_s = {delay_s:g} s; must be 0 to {_MOST_DELAY_S:g} s")
