from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident import DataError
from flexarm_ident.sampling import Jitter, longest_run, lost_samples, sampling_period_s

PERIOD_NS = 3_333_333


def stamps(scatter_ns: float, count: int = 3000, seed: int = 1) -> np.ndarray:
    even = np.arange(count) * PERIOD_NS
    return even + np.random.default_rng(seed).normal(0.0, scatter_ns, count).astype(np.int64)


def test_lost_samples___two_gaps_and_a_restart___counts_and_used_rows() -> None:
    sequence = np.array([1, 2, 5, 6, 7, 8, 10, 1, 2])
    (warning,) = lost_samples(longest_run(sequence), len(sequence))
    assert warning.name == "lost_samples"
    assert warning.figures == {
        "lost": 3.0,
        "places": 3.0,
        "first_row": 2.0,
        "last_row": 5.0,
        "samples": 9.0,
    }
    assert "3 samples lost at 3 places" in warning.text


def test_lost_samples___none___says_nothing() -> None:
    assert lost_samples(longest_run(np.arange(5, 50)), 45) == ()


@pytest.mark.parametrize("scatter_ns", [0.0, 50_000.0])
def test_sampling_period_s___steady_clock___says_nothing(scatter_ns: float) -> None:
    period_s, warnings = sampling_period_s(stamps(scatter_ns))
    assert period_s == pytest.approx(1.0 / 300.0, rel=1e-6)
    assert warnings == ()


def test_sampling_period_s___every_stamp_jitters___is_named_with_its_deviation() -> None:
    at = stamps(400_000.0)
    steps_s = np.diff(at) * 1e-9
    _, (warning,) = sampling_period_s(at)
    assert warning.name == "clock_jitter"
    figures = warning.figures
    # Each interval has the jitter of two stamps.
    assert figures["deviation_s"] == pytest.approx(np.sqrt(2.0) * 4e-4, rel=0.05)
    assert figures["usual_s"] == pytest.approx(np.median(steps_s))
    assert figures["worst_s"] == pytest.approx(steps_s[int(figures["row"])])
    assert figures["irregular"] == np.sum(np.abs(steps_s - figures["usual_s"]) > 0.5 / 300.0)
    assert figures["intervals"] == len(steps_s)


def test_sampling_period_s___one_late_sample___is_named_with_its_row() -> None:
    at = stamps(0.0)
    at[1000] += 3_000_000
    _, (warning,) = sampling_period_s(at)
    assert warning.figures["irregular"] == 2.0
    assert warning.figures["row"] in (999.0, 1000.0)
    assert "2 of 2999 sampling intervals are irregular" in warning.text


def test_jitter___intervals_in_pieces___same_as_at_once() -> None:
    steps_ns = np.diff(stamps(400_000.0))
    whole, parts = Jitter(), Jitter()
    usual_s = whole.add(steps_ns)
    for piece in np.array_split(steps_ns, 7):
        parts.add(piece)
    (one,), (other,) = whole.warnings(usual_s), parts.warnings(usual_s)
    # Every piece has a median of its own.
    for name in ("intervals", "row", "worst_s"):
        assert other.figures[name] == one.figures[name]
    assert other.figures["deviation_s"] == pytest.approx(one.figures["deviation_s"], rel=1e-2)


def test_sampling_period_s___standing_clock___raises() -> None:
    with pytest.raises(DataError, match="the stamps do not advance"):
        sampling_period_s(np.zeros(10, dtype=np.int64))
