"""Rules of the verdicts: figures, conclusions, and what cannot be compared.

A subject is judged in up to three parts. Its *figures* agree when most of them lie within a stated
band and are nearer to the thesis's than the best constant would be. Its *conclusions* are the
statements of the text, each with a test: one holds, stays open or is reversed. What cannot be as
printed, or is not printed, is *not comparable*, with the reason.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy import stats

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

Figures: TypeAlias = "Sequence[float] | NDArray[np.float64] | NDArray[np.int_]"
"""A figure of many runs, one per seed."""

LEVEL = 0.05
"""A statement holds when chance alone would bear it out as often in fewer than 5 % of all cases."""
MOST = 0.9
"""Share of the figures that must lie in the band; one run in ten may have had a bad day."""
BAND = 1.5
"""Errors of models agree within this factor: C_dat7 and C_dat10 of the thesis, which differ by a
fifth in gain and compensation, are further apart."""


class Verdict(Enum):
    """Relation of our result to the thesis's."""

    AGREES = "agrees"
    BY_CONSTRUCTION = "agrees by construction"
    SAME_CONCLUSIONS = "same conclusions"
    PARTLY = "partly"
    DIFFERS = "differs"
    NOT_COMPARABLE = "not comparable"
    ELSEWHERE = "see elsewhere"
    OURS = "our choice"


@dataclass(frozen=True)
class Statement:
    """A statement of the thesis, and how likely chance bears it out, or its opposite."""

    words: str
    p_value: float
    p_opposite: float

    @property
    def holds(self) -> bool:
        """Return whether it is borne out at `LEVEL`."""
        return self.p_value < LEVEL

    @property
    def is_reversed(self) -> bool:
        """Return whether its opposite is."""
        return self.p_opposite < LEVEL

    @property
    def outcome(self) -> str:
        """What became of it, in a word."""
        return "holds" if self.holds else "reversed" if self.is_reversed else "open"

    @property
    def text(self) -> str:
        """The statement with its outcome, and how likely chance alone gives that."""
        p_value = self.p_opposite if self.is_reversed else self.p_value
        by_chance = f" ({p_text(p_value)})" if 0.0 < p_value < 1.0 else ""
        return f"{self.words}: {self.outcome}{by_chance}"


def less(words: str, smaller: Figures, larger: Figures) -> Statement:
    """Test that the first figures of the same runs are the smaller ones, by the sign test."""
    return Statement(words, sign_test(smaller, larger), sign_test(larger, smaller))


def mostly(words: str, events: Sequence[bool] | NDArray[np.bool_]) -> Statement:
    """Test that something occurs in more than half of all runs."""
    seen = np.asarray(events, dtype=float)
    return less(words, 1.0 - seen, seen)


def always(words: str, events: Sequence[bool] | NDArray[np.bool_]) -> Statement:
    """Tell whether something occurs in every run; it is reversed where it mostly does not."""
    return Statement(words, float(not np.all(events)), mostly(words, events).p_opposite)


def exactly(words: str, *, holds: bool) -> Statement:
    """Return a statement about computed figures without any scatter."""
    return Statement(words, float(not holds), float(holds))


def ranked(words: str, theirs: Figures, ours: Figures) -> Statement:
    """Test that ours have the thesis's order (Spearman, one-sided)."""
    if len({*np.asarray(ours).tolist()}) == 1:
        return Statement(words, 1.0, 1.0)
    p_value, p_opposite = (
        float(stats.spearmanr(theirs, ours, alternative=side).pvalue)
        for side in ("greater", "less")
    )
    return Statement(words, p_value, p_opposite)


def all_of(words: str, parts: Sequence[Statement]) -> Statement:
    """Return the statement that all parts hold, with those that do not where outcomes differ.

    It is reversed where one part is and none holds; one for and one against leave it open.
    """
    opposite = min(1.0, len(parts) * min(each.p_opposite for each in parts))
    if any(each.holds for each in parts):
        opposite = 1.0
    if len({each.outcome for each in parts}) > 1:
        missed = [f"{each.words} {each.outcome}" for each in parts if not each.holds]
        rest = ["else it holds"] * (len(missed) < len(parts))
        words += f" ({', '.join(missed + rest)})"
    return Statement(words, max(each.p_value for each in parts), opposite)


@dataclass(frozen=True)
class Beside:
    """Figures of one kind, of the thesis and ours, and the factor within which they agree."""

    words: str
    thesis: tuple[float, ...]
    ours: tuple[float, ...]
    band: float = BAND

    def __post_init__(self) -> None:
        if len(self.thesis) != len(self.ours) or min((*self.thesis, *self.ours)) <= 0.0:
            raise ValueError(f"{self.words}: positive figures in pairs are compared")

    @property
    def within(self) -> int:
        """Number of figures within the band."""
        return int(np.sum(self._off(self.ours) <= np.log(self.band)))

    @property
    def distance(self) -> float:
        """Typical factor between the thesis's figures and ours: the mean of its logarithm."""
        return float(np.exp(np.mean(self._off(self.ours))))

    @property
    def constant_distance(self) -> float:
        """The same of the one number that comes nearest to all of the thesis's figures."""
        return float(np.exp(np.mean(self._off(float(np.median(self.thesis))))))

    @property
    def is_near(self) -> bool:
        """Return whether most are within the band."""
        return self.within >= MOST * len(self.thesis)

    @property
    def beats_constant(self) -> bool:
        """Return whether they are nearer than the best constant, rounding apart."""
        level = bool(np.isclose(self.distance, self.constant_distance))
        return self.distance < self.constant_distance and not level

    @property
    def agrees(self) -> bool:
        """Return whether most are within the band, and all nearer than the best constant."""
        return self.is_near and self.beats_constant

    @property
    def text(self) -> str:
        """The comparison in words."""
        ours = (
            f"{self.distance:.2f}" if np.isfinite(self.distance) else "no number (one is missing)"
        )
        return (
            f"{self.within} of {len(self.thesis)} {self.words} are within a factor of "
            f"{self.band:g}; ours are off by {ours} on the average, the best constant by "
            f"{self.constant_distance:.2f}"
        )

    def _off(self, ours: tuple[float, ...] | float) -> NDArray[np.float64]:
        ratios = np.asarray(ours, dtype=float) / np.asarray(self.thesis)
        return np.asarray(np.abs(np.log(ratios)), dtype=np.float64)


@dataclass(frozen=True)
class Judgement:
    """Verdict and its evidence: figures in some sentences, and the reason of a difference.

    Attributes
    ----------
    verdict : Verdict
        The verdict.
    because : str
        Its evidence.
    figures, statements : tuple
        The parts that it rests on.
    """

    verdict: Verdict
    because: str
    figures: tuple[Beside, ...] = ()
    statements: tuple[Statement, ...] = ()

    def __post_init__(self) -> None:
        if not self.because.strip():
            raise ValueError(f"a verdict ({self.verdict.value}) has to say what it rests on")

    @property
    def held(self) -> tuple[Statement, ...]:
        """Statements that hold."""
        return tuple(each for each in self.statements if each.holds)

    @property
    def reversed(self) -> tuple[Statement, ...]:
        """Statements whose opposite holds."""
        return tuple(each for each in self.statements if each.is_reversed)


def judged(
    *,
    figures: Sequence[Beside] = (),
    statements: Sequence[Statement] = (),
    evidence: str = "",
    reason: str = "",
    by_construction: bool = False,
) -> Judgement:
    """Judge a subject by its parts.

    Parameters
    ----------
    figures, statements : sequence of Beside and of Statement
        The parts: figures of several kinds, and what the text concludes.
    evidence : str
        More of our result, with figures.
    reason : str
        Reason of a difference; used only for one. Its figures are computed, as those of the
        evidence are.
    by_construction : bool
        Whether what agrees was built by the thesis's words, and says little of our results.

    Raises
    ------
    ValueError
        Without any part.
    """
    verdict = _verdict(figures, statements)
    if verdict is Verdict.AGREES and by_construction:
        verdict = Verdict.BY_CONSTRUCTION
    parts = []
    if figures:
        parts.append(f"Figures: {'; '.join(each.text for each in figures)}.")
    if statements:
        held = sum(each.holds for each in statements)
        listed = "; ".join(each.text for each in statements)
        parts.append(f"Conclusions, {held} of {len(statements)}: {listed}.")
    parts.append(evidence)
    if verdict in (Verdict.DIFFERS, Verdict.PARTLY):
        parts.append(reason)
    words = " ".join(part.strip() for part in parts if part.strip())
    return Judgement(verdict, words, tuple(figures), tuple(statements))


def _verdict(figures: Sequence[Beside], statements: Sequence[Statement]) -> Verdict:
    if not (figures or statements):
        raise ValueError("a subject without figures and conclusions cannot be judged")
    agree = [each.agrees for each in figures]
    hold = [each.holds for each in statements]
    if any(each.is_reversed for each in statements):
        return Verdict.DIFFERS
    if all(agree) and all(hold):
        return Verdict.AGREES
    if hold and all(hold):
        return Verdict.SAME_CONCLUSIONS
    near = [each.is_near for each in figures]
    return Verdict.PARTLY if any((*near, *hold)) else Verdict.DIFFERS


def elsewhere(key: str, words: str) -> Judgement:
    """Return the judgement of a subject whose comparison another one has."""
    return Judgement(Verdict.ELSEWHERE, f"{words} {key}.")


def not_comparable(reason: str) -> Judgement:
    """Return the judgement of what cannot be compared, with the reason."""
    return Judgement(Verdict.NOT_COMPARABLE, reason)


def count(judgements: Sequence[Judgement]) -> Mapping[Verdict, int]:
    """Count the verdicts of each kind."""
    return {kind: sum(each.verdict is kind for each in judgements) for kind in Verdict}


def sign_test(smaller: Figures, larger: Figures) -> float:
    """Return the probability that chance makes as many pairs come out in this order.

    The exact one-sided sign test; ties count against the claim.

    Parameters
    ----------
    smaller, larger : sequence of float
        Figures of the same runs; the claim is that the first is the smaller one.

    Raises
    ------
    ValueError
        For sequences of different lengths.
    """
    wins = sum(bool(a < b) for a, b in zip(smaller, larger, strict=True))
    return float(stats.binomtest(wins, len(smaller), alternative="greater").pvalue)


def p_text(p_value: float) -> str:
    """Return a p-value as text."""
    return f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"  # noqa: PLR2004
