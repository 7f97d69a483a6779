from __future__ import annotations

import numpy as np

from reproduction.chapter2 import order_survey, tables, thesis_way
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


def test_thesis_way___changes_are_relative_to_it() -> None:
    judgement = thesis_way.ways_judgement({thesis_way.THESIS_WAY: [0.4, 0.2], "x": [0.5, 0.2]})
    assert judgement.because.endswith("another: x +12%.")


def test_critically_stable___counts_as_in_the_thesis() -> None:
    assert order_survey.counts_as_stable(np.array([[1.000001]]))
    # Ac3_21u of section 3.2.
    assert not order_survey.counts_as_stable(np.array([[1.0000235]]))
