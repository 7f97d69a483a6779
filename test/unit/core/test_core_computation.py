"""Computations in their process: kept, interrupted, and ended."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_core.computation import CancelledError, Computation
from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

SLOW = """
import os, signal, time
import numpy as np
from flexarm_core.computation import serve


def compute(asked, report):
    if asked["deaf"]:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    report("at work", 0.5, {"process": os.getpid()})
    for _ in range(asked["tenths"]):
        time.sleep(0.1)
    if asked["tenths"] < 0:
        os._exit(3)
    return {"process": os.getpid(), "figures": np.array([1.5, np.nan]), "count": np.int64(3)}

serve(compute)
"""


@pytest.fixture
def slow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Computation]:
    (tmp_path / "slow_work.py").write_text(SLOW)
    monkeypatch.syspath_prepend(str(tmp_path))
    made = Computation("slow_work")
    yield made
    made.close()


def unheard(*_: object) -> None:
    """Take a report and do nothing."""


def computed(
    slow: Computation, tenths: int, report: Callable[..., None] = unheard, *, deaf: bool = False
) -> Mapping[str, Any]:
    slow.begin({"tenths": tenths, "deaf": deaf})
    return slow.answer(report)


def test_computation___kept_and_cancelled___answers_in_the_same_process(slow: Computation) -> None:
    first = computed(slow, 0)
    np.testing.assert_array_equal(first["figures"], [1.5, np.nan])
    assert first["count"] == 3

    def hear(stage: str, fraction: float | None, found: object = None) -> None:
        assert (stage, fraction, found) == ("at work", 0.5, {"process": first["process"]})
        slow.cancel()
        slow.cancel()

    with pytest.raises(CancelledError):
        computed(slow, 10_000, hear)
    assert computed(slow, 0)["process"] == first["process"]
    # An interrupt that comes behind the result finds nothing to end.
    slow.cancel()
    os.kill(first["process"], signal.SIGINT)
    assert computed(slow, 0)["process"] == first["process"]


def test_computation___cancelled_before_anybody_waits___is_not_computed(slow: Computation) -> None:
    computed(slow, 0)
    slow.begin({"tenths": 10_000, "deaf": False})
    slow.cancel()
    with pytest.raises(CancelledError):
        slow.answer(unheard)


def test_computation___that_does_not_hear_the_interrupt___is_left_for_another(
    slow: Computation,
) -> None:
    first = computed(slow, 0)
    with pytest.raises(CancelledError):
        computed(slow, 10_000, lambda *_: slow.cancel(), deaf=True)
    assert computed(slow, 0)["process"] != first["process"]


def test_computation___that_dies___is_reported_and_begins_anew(slow: Computation) -> None:
    first = computed(slow, 0)
    with pytest.raises(FlexarmError, match="ended without a result"):
        computed(slow, -1)
    assert computed(slow, 0)["process"] != first["process"]


def test_computation___closed_at_work___leaves_no_process(slow: Computation) -> None:
    process = computed(slow, 0)["process"]
    slow.begin({"tenths": 10_000, "deaf": True})
    slow.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
    with pytest.raises(CancelledError):
        slow.answer(unheard)
