"""Figure 2-16: the frequency response of a model from the closed loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from reproduction.chapter2.gauge_peaks import CAPTURED, FREQUENCIES_HZ, GAUGES, gains, has_peak
from reproduction.chapter2.order_survey import (
    fitted_half,
    identified,
    model_of,
    printed_order,
    thesis_record,
)
from reproduction.chapter2.waveform_modes import MODES_HZ
from reproduction.framework.evidence import OFTEN, SEEDS
from reproduction.framework.findings import Finding, Judgement, Plot, SideBySide, judged
from reproduction.framework.response_plot import range_plot
from reproduction.framework.sensors import SENSORS
from reproduction.framework.subjects import Call, Subject

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from reproduction.framework.subjects import Results

RECORD = "C_dat3"
LARGER_ORDER = 27
"""The order of Table 2-2: it tells whether a mode is missing in the record or in the order."""
_OTHERS = (0, 3)


def closed_loop_gains() -> dict[int, NDArray[np.float32]]:
    """Return the magnitudes of the models of the thesis's order and of a larger one.

    By order, (seeds, frequencies, 4).
    """
    orders = (printed_order(RECORD), LARGER_ORDER)
    found: dict[int, list[NDArray[np.float64]]] = {order: [] for order in orders}
    for seed in SEEDS:
        identification = identified(fitted_half(thesis_record(RECORD, seed)))
        for order in orders:
            found[order].append(gains(model_of(identification, order)[0]))
    return {order: np.array(some, dtype=np.float32) for order, some in found.items()}


def _figure(results: Results) -> Finding:
    found = {
        order: np.asarray(some, dtype=float)
        for order, some in results[Call(closed_loop_gains)].items()
    }
    order = printed_order(RECORD)
    shares = {
        each: [float(np.mean([has_peak(gain, mode) for gain in some])) for mode in MODES_HZ]
        for each, some in found.items()
    }
    at_modes = [int(np.argmin(np.abs(FREQUENCIES_HZ - mode))) for mode in MODES_HZ]
    strength = np.median(found[order][:, at_modes], axis=0)
    rows = tuple(
        (
            f"{mode:.1f}",
            *(f"{shares[each][k]:.0%}" for each in found),
            *(f"{strength[k, channel]:.3f}" for channel in range(len(SENSORS))),
        )
        for k, mode in enumerate(MODES_HZ)
    )
    headings = (
        "mode of our beam, Hz",
        *(f"peak in a gauge, {each} states" for each in found),
        *(f"{name}, V/V" for name in SENSORS),
    )
    return Finding(
        response_judgement(shares[order], shares[LARGER_ORDER], strength),
        (SideBySide("Modes in the response, 20 seeds", headings, rows),),
        tuple(
            Plot(
                f"Gain to the {name}, {order} states: median and range over 20 seeds",
                range_plot(FREQUENCIES_HZ, found[order][:, :, channel], name),
            )
            for channel, name in enumerate(SENSORS)
        ),
        (
            (
                f"Model Ac3_18: {order} states from the first half of {RECORD}, with noise as "
                "strong as the thesis's. The thesis reads two things off the figure: it has three "
                "peaks, where the beam has its modes; and they are stronger in the gauges than in "
                f"position and speed. A peak is at a mode when it is within {CAPTURED:.0%}; "
                "strength is the gain in V/V with 18 states, as a plot shows it."
            ),
        ),
    )


def response_judgement(
    shares: Sequence[float], larger: Sequence[float], strength: NDArray[np.float64]
) -> Judgement:
    """Judge Figure 2-16.

    Parameters
    ----------
    shares, larger
        Share of the seeds with a peak at each mode, with the thesis's order and a larger one.
    strength : ndarray, (modes, 4)
        Gain at each mode.
    """
    there = [share > OFTEN for share in shares]
    factor = float(np.min(strength[:, GAUGES].min(axis=1) / strength[:, _OTHERS].max(axis=1)))
    brought_out = not all(there) and all(share > OFTEN for share in larger)
    return judged(
        agrees=all(there) and factor > 1.0,
        same_ranking=factor > 1.0 and any(there),
        evidence=(
            f"Peaks at the modes: in {_percent(shares)} of the seeds with the thesis's order, in "
            f"{_percent(larger)} with {LARGER_ORDER} states. "
            + ("The missing mode is in the record: more states bring it out. " * brought_out)
            + (
                f"At every mode both gauges have a larger gain than position and speed, "
                f"{factor:.1f} times at least."
                if factor > 1.0
                else "The gauges do not have the larger gain at every mode."
            )
        ),
        reason="Noise as strong as this leaves too little of the modes in a model of this order.",
    )


def _percent(shares: Sequence[float]) -> str:
    return ", ".join(f"{share:.0%}" for share in shares)


SUBJECTS = (
    Subject("figure-2-16", "Frequency response of Ac3_18", (Call(closed_loop_gains),), _figure),
)
