from __future__ import annotations

import numpy as np

from reproduction.chapter2 import block_rows, order_survey, tables, thesis_way
from reproduction.chapter2.order_survey import ORDERS
from reproduction.framework.findings import SEEDS
from support.chapter2_surveys import made_up_survey


def test_leaving_text___counts_the_unstable_models_alone() -> None:
    swinging = np.zeros((len(SEEDS), len(ORDERS)), dtype=bool)
    stable = np.ones_like(swinging)
    swinging[0], stable[0, :4] = True, False
    stable[1, :4] = False
    found = made_up_survey("O_dat2", stable=stable, swinging=swinging)
    assert "In 50% of the unstable models" in tables.leaving_text([found])


def test_block_rows___most_entries_agree_with_those_that_are_taken() -> None:
    def swept(**changed: float) -> block_rows.Swept:
        values = {
            "stable_orders": 20.0,
            "mean_error": 0.374,
            "position_error": 0.1,
            "as_printed": 0.5,
            "peaks": 1.0,
        }
        return block_rows.Swept(**values | changed)

    # The thesis has 20 stable orders of C_dat2 and a mean error of 0.374.
    agrees = block_rows.agreement({"C_dat2": swept()})
    assert agrees == (1, 1, 0.5, 1)
    assert agrees.entries == 2.5
    assert block_rows.agreement({"C_dat2": swept(mean_error=0.57)}) == (1, 0, 0.5, 1)
    assert block_rows.agreement({"C_dat2": swept(stable_orders=31.0)}) == (0, 1, 0.5, 1)
    judgement = block_rows.sweep_judgement({20: 8.0, 30: 6.0, 40: 7.0}, 9)
    assert "8.0 with 20, 6.0 with 30, 7.0 with 40. " in judgement.because
    assert judgement.because.endswith("above 26 most agree with 40.")


def test_thesis_way___changes_are_relative_to_it() -> None:
    judgement = thesis_way.ways_judgement({thesis_way.THESIS_WAY: [0.4, 0.2], "x": [0.5, 0.2]})
    assert judgement.because.endswith("another: x +12%.")


def test_critically_stable___counts_as_in_the_thesis() -> None:
    assert order_survey.counts_as_stable(np.array([[1.000001]]))
    # Ac3_21u of section 3.2.
    assert not order_survey.counts_as_stable(np.array([[1.0000235]]))
