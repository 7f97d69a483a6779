"""Arm of the study: one rig for all chapters, whose parameters `bench calibration` looks for."""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from typing import TYPE_CHECKING

from flexarm_daq import RigParameters
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, NO_HUM_V, THESIS_NOISE_V

if TYPE_CHECKING:
    from collections.abc import Iterator

STUDY_RIG = RigParameters(noise_v=THESIS_NOISE_V)
"""The rig that every record, step and known mode of the study comes from.

Its noise makes the gauge errors of the models as large as the thesis's. It would bury the vibration
of Figure 4-10, so `calm_rig` is the same arm with good sensors.
"""

_rig: ContextVar[RigParameters] = ContextVar("rig of the study", default=STUDY_RIG)


def study_rig(payload_kg: float = 0.0) -> RigParameters:
    """Return the rig of the study with a payload."""
    return replace(_rig.get(), payload_kg=payload_kg)


def calm_rig(payload_kg: float = 0.0) -> RigParameters:
    """Return the rig of the study with a payload, little noise and no hum."""
    return replace(study_rig(payload_kg), noise_v=LOW_NOISE_V, hum_v=NO_HUM_V)


@contextmanager
def studied_on(rig: RigParameters) -> Iterator[None]:
    """Let the study run on another rig, in this process and inside the block only."""
    token = _rig.set(rig)
    try:
        yield
    finally:
        _rig.reset(token)
