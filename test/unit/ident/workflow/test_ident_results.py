"""Figures of an identification for a reader."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flexarm_ident.estimation.identification import Identification
from flexarm_ident.job import Results
from flexarm_ident.models.modes import ModeUncertainty


@pytest.mark.parametrize(("likelihood", "reported"), [(object(), (0.2, 0.3)), (None, ())])
def test_frequency_std_hz___is_reported_where_the_errors_are_noise(
    likelihood: object, reported: tuple[float, ...]
) -> None:
    modes = tuple(ModeUncertainty(9.0, 0.1, std_hz, 0.01) for std_hz in (0.2, 0.3))
    found: Any = SimpleNamespace(likelihood=likelihood, mode_uncertainty=modes)
    found.known_deviations = Identification.known_deviations.fget(found)  # type: ignore[attr-defined]
    outcome: Any = SimpleNamespace(identification=found)
    assert Results("model", Path(), outcome, {}).frequency_std_hz == reported
