"""What the claims of section 3.3 are tested on."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias

from reproduction.chapter3.reduction_calls import both_calls, trials
from reproduction.chapter3.reduction_examples import TABLES
from reproduction.chapter3.reduction_stages import LOW, THESIS
from reproduction.framework.subjects import Subject

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from reproduction.chapter3.reduction_stages import ReductionTrial
    from reproduction.framework.findings import Finding
    from reproduction.framework.subjects import Results


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
