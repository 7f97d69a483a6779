"""Computations for a page: refused, cancelled with the task that waits, and ended."""

from __future__ import annotations

import asyncio
import shutil
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_core.computation import Computation
from flexarm_core.errors import FlexarmError
from flexarm_live.graph.chain import computed
from support.project import BAGS

if TYPE_CHECKING:
    from collections.abc import Coroutine
    from pathlib import Path

PATIENCE_S = 600.0


def run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, PATIENCE_S))


def unheard(*_: object) -> None:
    """Take a report and do nothing."""


def test_computation___of_a_request_that_cannot_be___is_refused_with_its_line() -> None:
    asked = {"law": "pd", "models": ["nominal:0"], "margins": {}, "before": {}}

    async def work() -> None:
        tuning = Computation("flexarm_live.work.tuning")
        for _ in range(2):
            with pytest.raises(FlexarmError, match="law 'pd' is not tunable"):
                await computed(tuning, asked, unheard)

    run(work())


def test_identification___says_its_model_before_the_report___and_leaves_nothing_when_cancelled(
    tmp_path: Path,
) -> None:
    bag = tmp_path / "run1"
    shutil.copytree(BAGS / "c_dat3_0g", bag)
    folder = tmp_path / "models" / "run1"
    about = {"command": "identify"}
    asked = {"bag": str(bag), "folder": str(folder), "about": about, "signals": {}}
    models: list[dict[str, Any]] = []

    def leftovers() -> list[Path]:
        return [*folder.parent.glob("*"), *folder.parent.glob(".*")]

    async def work() -> None:
        identifying = Computation("flexarm_live.work.identification")
        found = asyncio.Event()

        def hear(stage: str, _fraction: float | None, model: Any = None) -> None:  # noqa: ANN401
            if model:
                assert stage == "writing"
                assert not folder.exists()
                models.append(model)
                found.set()

        replaced = asyncio.create_task(
            computed(identifying, asked | {"request": {"order": 12}}, hear)
        )
        await found.wait()
        replaced.cancel()
        with pytest.raises(asyncio.CancelledError):
            await replaced
        assert leftovers() == []
        result = await computed(identifying, asked | {"request": {"order": 14}}, hear)
        assert result == models[1]

    run(work())
    assert [model["order"] for model in models] == [12, 14]
    assert models[1]["command"] == "identify"
    assert {file.name for file in folder.iterdir()} == {"model.yaml", "report.html"}
