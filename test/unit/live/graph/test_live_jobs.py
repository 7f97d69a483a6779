"""Jobs from their begin to their end, and the names of records and models."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_core.errors import FlexarmError
from flexarm_live.graph.chain import Jobs
from flexarm_live.graph.store import Store

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from flexarm_core.computation import Report

PATIENCE_S = 120.0


async def told_by(jobs_of: Any, reported: list[Mapping[str, Any]]) -> None:  # noqa: ANN401
    """Run jobs and wait until the last has told its end."""
    ended = asyncio.Event()

    def report_it(message: Mapping[str, Any]) -> None:
        reported.append(message)
        if message["done"]:
            ended.set()

    await jobs_of(Jobs(report_it))
    await asyncio.wait_for(ended.wait(), PATIENCE_S)


def test_job___done_failed_or_cancelled___says_its_end_once() -> None:
    async def good(report: Report) -> Mapping[str, Any]:
        report("half", 0.5)
        return {"x": 1}

    async def bad(report: Report) -> Mapping[str, Any]:  # noqa: ARG001
        raise FlexarmError("no model\nfits")

    async def endless(report: Report) -> Mapping[str, Any]:  # noqa: ARG001
        await asyncio.Event().wait()
        return {}

    ends = []
    for work in (good, bad, endless):
        reported: list[Mapping[str, Any]] = []

        async def start(jobs: Jobs, work: Any = work) -> None:  # noqa: ANN401
            number = jobs.start("tune", work, left="half of it is there")
            assert jobs.has("tune")
            jobs.require_none("experiment")
            if work is endless:
                await asyncio.sleep(0.01)
                with pytest.raises(FlexarmError, match="job 1, tune, is at work"):
                    jobs.start("tune", work)
                with pytest.raises(FlexarmError, match="no job 9"):
                    jobs.cancel(9)
                assert jobs.cancel(number) == "tune"

        asyncio.run(told_by(start, reported))
        assert [each["done"] for each in reported].count(True) == 1
        ends.append((reported[-1]["ok"], reported[-1]["message"], reported[-1]["data"]))
    assert ends[0] == (True, "", {"x": 1})
    assert ends[1] == (False, "no model fits", {})
    assert ends[2][0] is False
    assert ends[2][1] == "cancelled: half of it is there"


def test_job___cancelled_twice___ends_well_once() -> None:
    ended, may_end = [], asyncio.Event()

    async def back() -> None:
        await may_end.wait()
        ended.append(1)

    async def work(report: Report) -> Mapping[str, Any]:  # noqa: ARG001
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.shield(back())
        return {}

    async def start(jobs: Jobs) -> None:
        number = jobs.start("experiment", work)
        await asyncio.sleep(0.01)
        for _ in range(2):
            assert jobs.cancel(number) == "experiment"
            await asyncio.sleep(0.01)
        assert jobs.has("experiment")
        assert not ended
        may_end.set()

    reported: list[Mapping[str, Any]] = []
    asyncio.run(told_by(start, reported))
    assert ended == [1]
    assert reported[-1]["message"].startswith("cancelled")


def test_store___knows___its_own_names_only(tmp_path: Path) -> None:
    store = Store(tmp_path / "live")
    assert store.bags() == []
    bag = store.new_bag("live")
    bag.mkdir()
    (bag / "metadata.yaml").touch()
    (tmp_path / "metadata.yaml").touch()
    assert store.bags() == [bag.name]
    assert store.bag(bag.name) == bag
    for name in ("..", ".", "", "/etc", f"../live/{bag.name}", "models"):
        with pytest.raises(FlexarmError, match="no record"):
            store.bag(name)
        assert store.report(name) is None
    folder = store.model_folder(bag.name)
    folder.mkdir(parents=True)
    (folder / "model.yaml").touch()
    (folder / "report.html").write_bytes(b"<p>")
    assert store.models() == [bag.name]
    assert store.report(bag.name) == b"<p>"
    assert store.report(f"{bag.name}/comparison") is None
    (folder / "comparison.html").write_bytes(b"<b>")
    assert store.report(f"{bag.name}/comparison") == b"<b>"
    assert store.report(f"{bag.name}/model.yaml") is None
    with pytest.raises(FlexarmError, match=r"no model 'x' \(known: live"):
        store.model_file("x")
