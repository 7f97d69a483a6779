from __future__ import annotations

from typing import TYPE_CHECKING

from numba.core.caching import CacheImpl

from flexarm_core.compilation import compiled

if TYPE_CHECKING:
    import pytest


def test_compiling___with_no_place_for_a_cache___goes_without(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])

    def double(value: float) -> float:
        return 2.0 * value

    assert compiled(double)(2.5) == 5.0
