"""Claims 2-1 to 2-4: the three kinds of experiments compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.experiments.catalogue import catalogue
from reproduction.chapter2.easier_rigs import free_calls
from reproduction.chapter2.order_survey import ORDERS
from reproduction.chapter2.tables import METHOD_TEXT, leaving_text, survey_calls, survey_of
from reproduction.framework.findings import (
    SEEDS,
    Finding,
    SideBySide,
    prose,
    spread,
    subject,
    thesis_table,
)
from reproduction.framework.verdicts import Judgement, judged, less, p_text, sign_test

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from numpy.typing import NDArray

    from reproduction.chapter2.order_survey import OrderSurvey
    from reproduction.framework.findings import Results
    from reproduction.framework.verdicts import Figures

    Figure = Callable[[OrderSurvey], NDArray[np.float64]]

OPEN, BOUNDED, CLOSED = (
    tuple(name for name in catalogue() if name.startswith(letter)) for letter in "OBC"
)
WAVEFORMS = {
    "square": ("O_dat2", "O_dat4"),
    "periodic random": ("O_dat6", "O_dat8"),
    "varying square": ("O_dat10", "O_dat12"),
    "random": ("O_dat13", "O_dat14"),
}
"""All with 2 V: the random waveform has no other."""
SQUARE = ("O_dat1", "O_dat2", "O_dat3", "O_dat4")
_BARE = tuple(name for name in CLOSED if catalogue()[name].payload_kg == 0.0)
_LOADED = tuple(name for name in CLOSED if name not in _BARE)
_CONSTANT, _RANDOM = (
    tuple(name for name in BOUNDED if catalogue()[name].waveform == f"bounded_{kind}")
    for kind in ("constant", "random")
)
_FREE_SEEDS = SEEDS[:2]
_FREE = {
    name: [free_calls(record, _FREE_SEEDS) for record in records]
    for name, records in (("open loop, square wave", SQUARE), ("closed loop", CLOSED))
}
_STABLE_TITLE = f"Stable orders, of {len(ORDERS)}"


def mean_dmv(found: OrderSurvey) -> NDArray[np.float64]:
    """Return the mean error by data matching, per seed."""
    return found.mean_dmv


def stable_orders(found: OrderSurvey) -> NDArray[np.float64]:
    """Return how many orders are stable, per seed."""
    return found.stable_orders


def position_dmv(found: OrderSurvey) -> NDArray[np.float64]:
    """Return the position's error by data matching, per seed."""
    return np.asarray(found.chosen_dmv[:, 0])


def mean_sfv(found: OrderSurvey) -> NDArray[np.float64]:
    """Return the mean error by set-point following, per seed."""
    return np.asarray(found.chosen_sfv.mean(axis=1))


def over(results: Results, records: Iterable[str], figure: Figure) -> NDArray[np.float64]:
    """Return the mean of a figure over experiments, per seed."""
    return np.asarray(np.mean([figure(survey_of(results, name)) for name in records], axis=0))


def median_over(results: Results, records: Iterable[str], figure: Figure) -> NDArray[np.float64]:
    """Return the median over experiments, per seed: of errors that may be infinite."""
    return np.asarray(np.median([figure(survey_of(results, name)) for name in records], axis=0))


def _listed(
    title: str, series: Mapping[str, Figures], form: str = ".3f", heading: str = "experiments"
) -> SideBySide:
    rows = tuple((name, spread(each, form)) for name, each in series.items())
    return SideBySide(title, (heading, "ours"), rows)


def _waveforms(results: Results) -> Finding:
    errors = {name: over(results, records, mean_dmv) for name, records in WAVEFORMS.items()}
    return Finding(
        waveform_judgement(errors),
        (_listed("Mean error, 2 V", errors, heading="waveform"),),
        text=(METHOD_TEXT, "Each waveform has two records with 2 V, at 300 and 500 Hz."),
    )


def waveform_judgement(errors: Mapping[str, Figures]) -> Judgement:
    """Judge whether the square wave gives the least errors, and the random one the largest."""
    found = {name: np.asarray(each, dtype=np.float64) for name, each in errors.items()}
    middle = {name: float(np.median(each)) for name, each in found.items()}
    ranking = sorted(middle, key=lambda name: middle[name])
    return judged(
        statements=(
            less(
                "the square wave is better than the best of the others",
                errors["square"],
                np.min([each for name, each in found.items() if name != "square"], axis=0),
            ),
            less(
                "the random one is worse than the worst of the others",
                np.max([each for name, each in found.items() if name != "random"], axis=0),
                errors["random"],
            ),
        ),
        evidence=f"From the best to the worst: {', '.join(ranking)}.",
        reason=f"On our rig the {ranking[-1]} one is the worst.",
    )


def _bounded(results: Results) -> Finding:
    stable = {
        "open loop": over(results, OPEN, stable_orders),
        "bounded": over(results, BOUNDED, stable_orders),
    }
    errors = {
        "constant magnitude": over(results, _CONSTANT, mean_dmv),
        "random magnitude": over(results, _RANDOM, mean_dmv),
    }
    return Finding(
        bounded_judgement(
            *(*stable.values(), *errors.values()), leaving=_leaving(results, BOUNDED)
        ),
        (
            _listed(_STABLE_TITLE, stable, ".1f"),
            _listed("Mean error", errors, heading="bounded experiments"),
        ),
        text=(METHOD_TEXT,),
    )


def _leaving(results: Results, records: Iterable[str]) -> str:
    return leaving_text(survey_of(results, record) for record in records)


def bounded_judgement(
    stable_open: Figures,
    stable_bounded: Figures,
    constant: Figures,
    random: Figures,
    *,
    leaving: str,
) -> Judgement:
    """Judge two claims: bounded experiments give stable models, constant magnitude good ones."""
    return judged(
        statements=(
            less("a stable model is easier than in the open loop", stable_open, stable_bounded),
            less("a constant magnitude gives the smaller error", constant, random),
        ),
        evidence=f"Stable orders: {np.median(stable_bounded):.1f} beside "
        f"{np.median(stable_open):.1f}; errors: {np.median(constant):.3f} beside "
        f"{np.median(random):.3f}.",
        reason=leaving,
    )


def _stable(results: Results) -> Finding:
    groups = {
        "open loop": OPEN,
        "closed loop": CLOSED,
        "closed loop, no payload": _BARE,
        "closed loop, with payload": _LOADED,
    }
    series = {name: over(results, records, stable_orders) for name, records in groups.items()}
    text = prose("claim-2-3.text", bare=len(_BARE), closed=len(CLOSED))
    everything, closed, bare, _ = series.values()
    return Finding(
        stability_judgement(everything, closed, bare, leaving=_leaving(results, _LOADED)),
        (_listed(_STABLE_TITLE, series, ".1f"),),
        text=(METHOD_TEXT, text),
    )


def stability_judgement(
    open_loop: Figures, closed: Figures, bare: Figures, *, leaving: str
) -> Judgement:
    """Judge whether the closed loop gives more stable orders, on the whole and without payload."""
    bare_p = sign_test(open_loop, bare)
    return judged(
        statements=(less("a stable model is easier than in the open loop", open_loop, closed),),
        evidence=f"All closed-loop experiments have {np.median(closed):.1f} stable orders, the "
        f"open loop {np.median(open_loop):.1f}; without payload, like with like, "
        f"{np.median(bare):.1f} ({p_text(bare_p)}).",
        reason=leaving,
    )


def _accuracy(results: Results) -> Finding:
    position, following, matching = (
        {
            "open loop": average(results, OPEN, figure),
            **({"open loop, square wave": over(results, SQUARE, mean_dmv)} if compared else {}),
            "closed loop": average(results, CLOSED, figure),
        }
        for average, figure, compared in (
            (over, position_dmv, False),
            (median_over, mean_sfv, False),
            (over, mean_dmv, True),
        )
    )
    return Finding(
        accuracy_judgement(position, following, matching, _free_matching(results)),
        (
            _listed("Position, error by data matching", position),
            _listed("Mean error by set-point following", following),
            _listed("Mean error by data matching", matching),
        ),
        text=(METHOD_TEXT, _printed_matching()),
    )


def _free_matching(results: Results) -> dict[str, float]:
    """Return the mean errors by data matching without friction and gear play."""
    return {
        name: float(np.mean([np.median([results[call] for call in each]) for each in calls]))
        for name, calls in _FREE.items()
    }


def _printed_matching() -> str:
    open_loop = {record: row["mean"] for record, row in thesis_table("table_2_1").items()}
    closed = np.mean([row["mean"] for row in thesis_table("table_2_4").values()])
    square = np.mean([open_loop[record] for record in SQUARE])
    return prose(
        "claim-2-4.text", closed=closed, whole=np.mean(list(open_loop.values())), square=square
    )


def accuracy_judgement(
    position: Mapping[str, Figures],
    following: Mapping[str, Figures],
    matching: Mapping[str, Figures],
    free: Mapping[str, float],
) -> Judgement:
    """Judge the closed loop: better position, better set-point following, worse data matching."""
    compared = {
        "the position is better": (position, "open loop"),
        "set-point following is better": (following, "open loop"),
        "data matching is worse": (matching, "open loop, square wave"),
    }
    statements = []
    for words, (errors, other) in compared.items():
        pair = (errors["closed loop"], errors[other])
        statements.append(less(words, *(pair if errors is not matching else pair[::-1])))
    figures = "; ".join(
        f"{words}: {np.median(some['closed loop']):.3f} beside {np.median(some[other]):.3f}"
        for words, (some, other) in compared.items()
    )
    return judged(
        statements=statements,
        evidence=f"Closed loop beside open loop: {figures}.",
        reason=prose(
            "claim-2-4.reason",
            closed=free["closed loop"],
            square=free["open loop, square wave"],
            seeds=len(_FREE_SEEDS),
            makes="makes"
            if free["closed loop"] > free["open loop, square wave"]
            else "does not make",
        ),
    )


SUBJECTS = (
    subject(
        "claim-2-1",
        survey_calls(*(name for records in WAVEFORMS.values() for name in records)),
        _waveforms,
    ),
    subject("claim-2-2", survey_calls(*OPEN, *BOUNDED), _bounded),
    subject("claim-2-3", survey_calls(*OPEN, *CLOSED), _stable),
    subject(
        "claim-2-4",
        (
            *survey_calls(*OPEN, *CLOSED),
            *(call for each in _FREE.values() for part in each for call in part),
        ),
        _accuracy,
    ),
)
