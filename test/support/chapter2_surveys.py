"""Made-up surveys of chapter 2: figures of models that were never identified."""

from __future__ import annotations

from typing import Any

import numpy as np

from reproduction.chapter2 import modes, order_survey, validation
from reproduction.chapter2.order_survey import ORDERS, OrderSurvey
from reproduction.framework.findings import SEEDS, thesis_table


def made_up_survey(record: str, **changed: Any) -> OrderSurvey:  # noqa: ANN401 - any field
    """A survey whose figures are those of the thesis, the same with every seed."""
    row = thesis_table(order_survey.TABLE_OF[record[0]])[record]
    seeds = len(SEEDS)
    values: dict[str, Any] = {
        "record": record,
        "stable": np.tile(np.isin(ORDERS, row["stable"]), (seeds, 1)),
        "swinging": np.zeros((seeds, len(ORDERS)), dtype=bool),
        "chosen_orders": np.full(seeds, row["order"]),
        "chosen_dmv": np.tile(row["delta"], (seeds, 1)),
        "chosen_sfv": np.full((seeds, 4), 0.5),
        "chosen_gain": np.ones((seeds, 4)),
        "printed_dmv": np.tile(row["delta"], (seeds, 1)),
        "printed_sfv": np.full((seeds, 4), 0.5),
        "printed_loop_stable": np.ones(seeds, dtype=bool),
        "singular_values": np.tile(0.5 ** np.arange(60), (seeds, 1)),
    }
    return OrderSurvey(**values | changed)


def made_up_modes(*, near: bool) -> modes.WaveformModes:
    modes_hz = modes.MODES_HZ if near else modes.BETWEEN_HZ
    seeds = len(SEEDS)
    return modes.WaveformModes(
        (tuple(modes_hz.tolist()),) * seeds,
        np.full((seeds, 3), near),
        np.full((seeds, 2), not near),
    )


def made_up_late_record(*, away: bool) -> validation.LateRecord:
    seeds = len(SEEDS)
    return validation.LateRecord(
        np.full(seeds, away), np.full(seeds, 24.7), np.full((seeds, 4), 0.2)
    )
