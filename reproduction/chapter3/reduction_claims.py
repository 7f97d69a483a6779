"""What the claims of section 3.3 are tested on."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias

from flexarm_reproduction.reduction_calls import both_calls, trials
from flexarm_reproduction.reduction_examples import TABLES
from flexarm_reproduction.reduction_stages import LOW, THESIS
from flexarm_reproduction.subjects import Subject

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flexarm_reproduction.findings import Finding
    from flexarm_reproduction.reduction_stages import ReductionTrial
    from flexarm_reproduction.subjects import Results


CODES = tuple(TABLES.values())
"""Examples that claims are tested on."""
NOISES: Mapping[str, str] = MappingProxyType({THESIS: "strong", LOW: "little"})
Trials: TypeAlias = "Mapping[tuple[str, str], Sequence[ReductionTrial]]"
"""Results by example and noise."""


def claim_subject(
    number: int, title: str, claim: Callable[[Trials], Finding], codes: Sequence[str] = CODES
) -> Subject:
    """Return a claim of section 3.3 as a subject.

    Parameters
    ----------
    number, title
        Of the claim.
    claim
        Tests it on results of `codes`.
    codes
        Keys of `EXAMPLES`.
    """

    def build(results: Results) -> Finding:
        return claim(
            {(code, noise): trials(results, code, noise) for code in codes for noise in NOISES}
        )

    needs = tuple(call for code in codes for call in both_calls(code))
    return Subject(f"claim-3-{number}", title, needs, build)
