from __future__ import annotations

import numpy as np

from flexarm_ident import IoData
from flexarm_ident.models.modes import rank_table, ranked_modes
from support.ident_systems import arm_model, square_wave, step_by_step


def test_rank_table___arm___both_orders_fall_and_hold_every_mode() -> None:
    model, u = arm_model(), square_wave(2000, 1)
    data = IoData(u, step_by_step(model, u), dt_s=float(model.dt))
    modes = ranked_modes(model, [data], np.ones(4))
    table = rank_table(modes)
    for listed, index in ((table.by_msv, "msv"), (table.by_mrm, "mrm")):
        values = [getattr(mode, index) for mode in listed]
        assert values == sorted(values, reverse=True)
        assert {mode.label for mode in listed} == {mode.label for mode in modes}
    assert [mode.label for mode in table.by_msv] != [mode.label for mode in table.by_mrm]
