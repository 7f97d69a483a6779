"""Choices of the study, one value for all chapters: its rig, and what the thesis leaves open.

`docs/reproduction/sensitivity.md` varies each of them, and says what makes its value likely.
"""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from flexarm_daq import RigParameters
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, NO_HUM_V, THESIS_NOISE_V

if TYPE_CHECKING:
    from collections.abc import Iterator

STUDY_RIG = RigParameters(
    noise_v=THESIS_NOISE_V,
    coulomb_friction_nm=0.275,
    viscous_friction_nm_s_per_rad=0.1,
    mass_damping_per_s=1.0,
    base_gauge_v_per_nm=2.4,
)
"""The rig that every record, step and known mode of the study comes from.

Of the rigs that `bench calibration` searched, with the settings that the study had then, it has the
figures nearest to the thesis's. Its noise makes the gauge errors of the models as large as the
thesis's. It would bury the vibration of Figure 4-10, so `calm_rig` is the same arm with good
sensors.
"""


@dataclass(frozen=True)
class Choices:
    """What the thesis leaves open.

    Attributes
    ----------
    rig : RigParameters
        Arm, drive and sensors.
    hold_s : float
        Time for which a random wave holds a number; at 2 ms every sample of 300 or 500 Hz has its
        own, since the thesis names no hold.
    block_rows : int
        Block rows q of (2-18): (2-10) asks for more than states, and Table 2-6 has 36.
    criterion_s : float
        Length of the step of the criteria (4-1) and (4-3): with it the thesis's gains have its sum
        of E on its models.
    """

    rig: RigParameters = field(default_factory=lambda: STUDY_RIG)
    hold_s: float = 0.002
    block_rows: int = 40
    criterion_s: float = 3.5


CHOICES = Choices()
_choices: ContextVar[Choices] = ContextVar("choices of the study", default=CHOICES)


def choices() -> Choices:
    """Return the choices in force."""
    return _choices.get()


def study_rig(payload_kg: float = 0.0) -> RigParameters:
    """Return the rig of the study with a payload."""
    return replace(choices().rig, payload_kg=payload_kg)


def calm_rig(payload_kg: float = 0.0) -> RigParameters:
    """Return the rig of the study with a payload, little noise and no hum."""
    return replace(study_rig(payload_kg), noise_v=LOW_NOISE_V, hum_v=NO_HUM_V)


@contextmanager
def studied_with(other: Choices) -> Iterator[None]:
    """Let the study run with other choices, in this process and inside the block only."""
    token = _choices.set(other)
    try:
        yield
    finally:
        _choices.reset(token)
