from __future__ import annotations

import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.health import realtime
from flexarm_bringup.verbs.health.doctor import doctor
from flexarm_bringup.verbs.health.realtime import Floor
from flexarm_node.statistics import Percentiles


def floors(kept: tuple[bool, ...]) -> list[Floor]:
    late = Percentiles(1e-5, 1e-5, 1e-5, 1e-5)
    return [
        Floor(rate_hz, late, 1000, 0 if good else 3, 0)
        for rate_hz, good in zip(realtime.RATES_HZ, kept, strict=True)
    ]


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        ((True, True, True, False, False), "500 Hz is kept: nothing missed"),
        ((True, True, True, True, False), "1000 Hz is kept in one process (up --compose)"),
        # A rate above one that is not kept was luck.
        ((True, False, True, False, False), "100 Hz is kept: nothing missed"),
        ((False, True, True, True, False), "no rate can be promised: at 100 Hz the loop was up"),
        ((False, False, False, False, False), "no rate can be promised: at 100 Hz the loop was up"),
    ],
)
def test_verdict___is_the_highest_rate_up_to_which_all_are_kept(
    kept: tuple[bool, ...], said: str
) -> None:
    assert realtime.verdict(floors(kept)).startswith(said)


def test_doctor_realtime___prints_a_row_a_rate_and_the_verdict(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured = iter(floors((True, True, True, False, False)))
    monkeypatch.setattr(realtime, "prefer_realtime", lambda: None)
    monkeypatch.setattr(realtime, "sleep_floor", lambda *_: next(measured))
    result = CliRunner().invoke(doctor, ["--realtime"])
    assert result.exit_code == 0, result.output
    assert result.output.count("0 of 1000") == 3
    assert result.output.count("3 of 1000") == 2
    assert "500 Hz is kept" in result.output
