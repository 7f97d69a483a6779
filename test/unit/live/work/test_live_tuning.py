"""What a page is shown of a tuning and of an identification."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_control import PdpGains, nominal_model
from flexarm_control.design.margins import margins
from flexarm_core.errors import SettingError
from flexarm_live.work.tuning import tuned


def test_tuned___on_a_nominal_model___has_margins_that_its_curves_show() -> None:
    before = {"pdpc.kp": 0.5, "pdpc.kd": 3.3, "pdpc.ksg": 0.07}
    asked = {"law": "pdpc", "models": ["nominal:0"], "margins": {}, "before": before}
    stages: list[str] = []
    found = tuned(asked, lambda stage, *_: stages.append(stage))
    gains = {name.removeprefix("pdpc."): value for name, value in found["gains"].items()}
    assert gains.keys() == {"kp", "kd", "ksg"}
    expected = margins(nominal_model(0.0), PdpGains(**gains))
    (loop,) = found["margins"]
    assert loop["gain_margin_db"] == pytest.approx(expected.gain_margin_db)
    assert loop["phase_margin_deg"] >= found["required"]["phase_margin_deg"] - 0.1
    response = loop["response"]
    # At the crossing of gain one the drawn phase is the margin above -180 deg.
    phase_deg = np.interp(loop["phase_hz"], response["hz"], response["phase_deg"])
    assert abs((phase_deg + 180.0) % 360.0 - loop["phase_margin_deg"]) < 3.0
    step = found["step"]
    assert len(step["t_s"]) == len(step["before"]) == len(step["after"])
    assert step["after"][0] == pytest.approx(0.0, abs=1e-9)
    assert stages[0] == "reading"


def test_tuned___of_a_law_without_a_tuning___is_refused() -> None:
    asked = {"law": "pd", "models": ["nominal:0"], "margins": {}, "before": {}}
    with pytest.raises(SettingError, match="law 'pd' is not tunable"):
        tuned(asked, lambda *_: None)
