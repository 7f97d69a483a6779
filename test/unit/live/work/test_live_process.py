"""Computations in their process: kept, interrupted, and ended."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_core.errors import FlexarmError
from flexarm_live.work.process import Computation
from support.project import BAGS

if TYPE_CHECKING:
    from collections.abc import Coroutine
    from pathlib import Path

PATIENCE_S = 600.0
SLOW = """
import os, signal, time
from flexarm_live.work.process import serve

NO_SIGNALS: dict[str, list[str]] = {"inputs": [], "outputs": [], "times": []}


def compute(asked, report):
    if asked.get("deaf"):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    report("at work", 0.5, {"process": os.getpid()})
    for _ in range(asked["tenths"]):
        time.sleep(0.1)
    if asked["tenths"] < 0:
        os._exit(3)
    return {"process": os.getpid()}

serve(compute)
"""


@pytest.fixture
def slow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Computation:
    (tmp_path / "slow_work.py").write_text(SLOW)
    monkeypatch.syspath_prepend(str(tmp_path))
    return Computation("slow_work")


def run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, PATIENCE_S))


def unheard(*_: object) -> None:
    """Take a report and do nothing."""


def test_computation___kept_and_cancelled___answers_in_the_same_process(slow: Computation) -> None:
    async def work() -> None:
        first = await slow.run({"tenths": 0}, unheard)
        heard = asyncio.Event()

        def hear(stage: str, fraction: float | None, found: object = None) -> None:
            assert (stage, fraction, found) == ("at work", 0.5, first)
            heard.set()

        endless = asyncio.create_task(slow.run({"tenths": 10_000}, hear))
        await heard.wait()
        endless.cancel()
        with pytest.raises(asyncio.CancelledError):
            await endless
        assert await slow.run({"tenths": 0}, unheard) == first
        # An interrupt that comes behind the result finds nothing to end.
        os.kill(first["process"], signal.SIGINT)
        assert await slow.run({"tenths": 0}, unheard) == first

    run(work())


def test_computation___that_does_not_hear_the_interrupt___is_left_for_another(
    slow: Computation,
) -> None:
    async def work() -> None:
        first = await slow.run({"tenths": 0}, unheard)
        heard = asyncio.Event()
        deaf = asyncio.create_task(
            slow.run({"tenths": 10_000, "deaf": True}, lambda *_: heard.set())
        )
        await heard.wait()
        deaf.cancel()
        with pytest.raises(asyncio.CancelledError):
            await deaf
        assert await slow.run({"tenths": 0}, unheard) != first

    run(work())


def test_computation___that_dies___is_reported_and_begins_anew(slow: Computation) -> None:
    async def work() -> None:
        first = await slow.run({"tenths": 0}, unheard)
        with pytest.raises(FlexarmError, match="ended without a result"):
            await slow.run({"tenths": -1}, unheard)
        assert await slow.run({"tenths": 0}, unheard) != first

    run(work())


def test_computation___of_a_request_that_cannot_be___is_refused_with_its_line() -> None:
    asked = {"law": "pd", "models": ["nominal:0"], "margins": {}, "before": {}}

    async def work() -> None:
        tuning = Computation("flexarm_live.work.tuning")
        for _ in range(2):
            with pytest.raises(FlexarmError, match="law 'pd' is not tunable"):
                await tuning.run(asked, unheard)

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

        replaced = asyncio.create_task(identifying.run(asked | {"request": {"order": 12}}, hear))
        await found.wait()
        replaced.cancel()
        with pytest.raises(asyncio.CancelledError):
            await replaced
        assert leftovers() == []
        result = await identifying.run(asked | {"request": {"order": 14}}, hear)
        assert result == models[1]

    run(work())
    assert [model["order"] for model in models] == [12, 14]
    assert models[1]["command"] == "identify"
    assert {file.name for file in folder.iterdir()} == {"model.yaml", "report.html"}
