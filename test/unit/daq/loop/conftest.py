from __future__ import annotations

import pytest

from support.acquisition_bench import Clock


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Return the clock by which the acquisition goes."""
    made = Clock()
    monkeypatch.setattr("flexarm_daq.loop.acquisition.time", made)
    return made
