"""One model per bag: table, trend, and what is computed again."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import distributed
import pytest

from flexarm_core.errors import DataError
from flexarm_core.outputs import MARK, OutputError
from flexarm_core.workers import Workers
from flexarm_ident import job, load_model, selection
from flexarm_ident.series import run as series_run
from flexarm_ident.series.run import identify_each
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.foreign_bags import (
    MODES_HZ,
    driven_joint,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flexarm_ident.series.rows import Row

QUICK = Request(order=4, block_rows=10, method="orse", friction=False)
CHOSEN = selection(["/joint_states.effort[0]"], ["angle=/joint_states.position[0]"])
HERE = Workers(jobs=1)


@pytest.fixture
def bags(tmp_path: Path) -> list[Path]:
    return [driven_joint(tmp_path / "runs" / f"day_{day}", day + 1, day) for day in range(3)]


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Receive the record of each model that is computed; a line stands for the report."""
    seen: list[str] = []

    def noted(records: Sequence[object], request: Request) -> object:
        seen.append(str(records[0].source).rpartition("/")[2])  # type: ignore[attr-defined]
        return run(records, request)  # type: ignore[arg-type]

    monkeypatch.setattr(series_run, "run", noted)
    monkeypatch.setattr(job, "render_report", lambda subject, **_: f"{subject.name} {MARK}\n")
    return seen


def each(bags: Sequence[Path], out: Path, request: Request = QUICK) -> series_run.Series:
    return identify_each(bags, out, request, channels=CHOSEN, workers=HERE)


def close_to_the_rig(row: Row) -> bool:
    frequencies = [row.number(f"frequency_{number}") for number in (1, 2)]
    return frequencies == pytest.approx(MODES_HZ, rel=0.005)


def test_each___page_of_somebody_else___is_refused_before_the_work(
    tmp_path: Path, bags: list[Path], computed: list[str]
) -> None:
    page = tmp_path / "index.html"
    page.write_text("mine")
    with pytest.raises(OutputError, match=r"index\.html: was not written by flexarm: .*--force"):
        each(bags, tmp_path)
    assert page.read_text() == "mine"
    assert not computed


def test_each___parquet_of_somebody_else___is_refused_before_the_work(
    tmp_path: Path, bags: list[Path], computed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(series_run, "require_parquet", lambda: None)
    (tmp_path / "models.parquet").write_text("mine")
    with pytest.raises(OutputError, match=r"models\.parquet: was not written by flexarm"):
        identify_each(bags, tmp_path, QUICK, channels=CHOSEN, parquet=True, workers=HERE)
    assert (tmp_path / "models.parquet").read_text() == "mine"
    assert not computed


@pytest.mark.slow
@pytest.mark.exhaustive
def test_each___report_of_somebody_else_in_a_bags_folder___fails_that_bag_alone(
    tmp_path: Path, bags: list[Path], computed: list[str]
) -> None:
    out = tmp_path / "out"
    each(bags[:2], out)
    report = next(out.glob("*day_0/report.html"))
    report.write_text("mine")
    series = each(bags[:2], out, replace(QUICK, order=5))
    assert "report.html: was not written by flexarm" in series.rows[0].failure
    assert series.rows[1].failure == ""
    assert report.read_text() == "mine"
    assert len(computed) == 4
    again = identify_each(
        bags[:2], out, replace(QUICK, order=5), channels=CHOSEN, force=True, workers=HERE
    )
    assert (again.failed, again.skipped) == (0, 1)


@pytest.mark.usefixtures("computed")
@pytest.mark.slow
def test_each___bags_of_one_rig___have_a_row_and_a_folder_each(
    tmp_path: Path, bags: list[Path]
) -> None:
    out = tmp_path / "out"
    broken = tmp_path / "runs" / "broken"
    series = each([bags[0], broken, *bags[1:]], out)

    assert [row.bag for row in series.rows] == list(map(str, [bags[0], broken, *bags[1:]]))
    assert (series.failed, series.skipped) == (1, 0)
    assert series.rows[1].failure == f"{broken}: no such bag"
    table = (out / "models.csv").read_text().splitlines()
    assert len(table) == 5
    assert table[0].startswith("bag,begun,verdict,samples,rate_hz,method,order,error_mean,")
    page = (out / "index.html").read_text()
    assert "begin of the record, days from 2023-11-14 " in page
    for day, row in zip(range(3), [series.rows[0], *series.rows[2:]], strict=True):
        assert close_to_the_rig(row)
        assert row.number("damping_1") == pytest.approx(0.03, abs=0.003)
        assert row.cells["verdict"] == "good"
        assert row.cells["begun"].startswith(f"2023-11-{14 + day}T")
        folder = str(bags[day]).strip("/").replace("/", "_").replace("-", "_").replace(".", "_")
        model = load_model(out / folder / "model.yaml")
        assert (model.nstates, model.output_labels) == (4, ["angle"])
        assert f'href="{folder}/report.html"' in page


@pytest.mark.slow
def test_each___again___computes_what_changed(
    tmp_path: Path, bags: list[Path], computed: list[str]
) -> None:
    out = tmp_path / "out"
    broken = tmp_path / "runs" / "late"
    each([*bags, broken], out)
    computed.clear()

    # One bag is another one now, one that failed is there, and a new one came.
    shutil.rmtree(bags[1])
    driven_joint(bags[1], 77, 1)
    driven_joint(broken, 78)
    new = driven_joint(tmp_path / "runs" / "new", 79)
    series = each([*bags, broken, new], out)
    assert computed == ["day_1", "late", "new"]
    assert (series.skipped, series.failed) == (2, 0)
    assert all(map(close_to_the_rig, series.rows))

    computed.clear()
    each(bags[:1], out, Request(order=6, block_rows=10, method="orse", friction=False))
    assert computed == ["day_0"]
    # Rows of other bags stay.
    assert len((out / "models.csv").read_text().splitlines()) == 6


@pytest.mark.slow
def test_each___interrupted___keeps_what_has_ended(
    tmp_path: Path, bags: list[Path], computed: list[str]
) -> None:
    def interrupt(_: str, done: float) -> None:
        if done > 0.5:
            raise KeyboardInterrupt

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        identify_each(bags, out, QUICK, channels=CHOSEN, workers=HERE, progress=interrupt)
    assert len((out / "models.csv").read_text().splitlines()) == 3
    before = len(computed)

    series = each(bags, out)
    assert series.skipped == 2
    assert len(computed) == before + 1


def assert_same(one: series_run.Series, other: series_run.Series) -> None:
    for left, right in zip(one.rows, other.rows, strict=True):
        assert (left.bag, list(left.cells)) == (right.bag, list(right.cells))
        assert left.is_of(right.cells["record_sha256"], right.cells["request_sha256"])
        assert list(left.main_modes()) == [pytest.approx(mode) for mode in right.main_modes()]


def on(workers: Workers, bags: list[Path], out: Path) -> series_run.Series:
    return identify_each(bags, out, QUICK, channels=CHOSEN, workers=workers)


@pytest.mark.slow
def test_each___two_cores___give_the_same(tmp_path: Path, bags: list[Path]) -> None:
    alone = on(HERE, bags, tmp_path / "alone")
    assert_same(alone, on(Workers(jobs=2), bags, tmp_path / "two"))


@pytest.mark.exhaustive
def test_each___cluster___gives_the_same(tmp_path: Path, bags: list[Path]) -> None:
    alone = on(HERE, bags, tmp_path / "alone")
    local_cluster: Any = distributed.LocalCluster
    with local_cluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        workers = Workers(dask=cluster.scheduler_address)
        assert_same(alone, on(workers, bags, tmp_path / "cluster"))


def test_each___two_bags_of_one_folder___are_refused(tmp_path: Path) -> None:
    first, second = tmp_path / "a-b", tmp_path / "a.b"
    with pytest.raises(DataError, match=r"a\.b and .*a-b would both be .*a_b: rename one"):
        each([first, second], tmp_path / "out")


@pytest.mark.usefixtures("computed")
def test_each___parquet___has_the_figures_as_numbers(tmp_path: Path, bags: list[Path]) -> None:
    parquet = pytest.importorskip(
        "pyarrow.parquet", reason="pip install -r requirements/parquet.in"
    )
    out = tmp_path / "out"
    broken = tmp_path / "runs" / "broken"
    series = identify_each([*bags, broken], out, QUICK, channels=CHOSEN, parquet=True, workers=HERE)

    lines = parquet.read_table(out / "models.parquet").to_pylist()
    assert [line["bag"] for line in lines] == [row.bag for row in series.rows]
    for line, row in zip(lines[:3], series.rows, strict=False):
        assert line["frequency_1"] == pytest.approx(row.number("frequency_1"))
        assert line["begun"].isoformat() == row.cells["begun"]
        assert (line["verdict"], line["failure"]) == ("good", None)
    assert (lines[3]["order"], lines[3]["begun"]) == (None, None)
    assert "no such bag" in lines[3]["failure"]


def test_each___parquet_without_pyarrow___is_refused_before_the_work(
    tmp_path: Path, bags: list[Path], computed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(DataError, match=r"requirements/parquet\.in"):
        identify_each(bags, tmp_path / "out", QUICK, channels=CHOSEN, parquet=True, workers=HERE)
    assert not computed
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("computed")
def test_each___clock_that_begins_at_zero___says_no_date(tmp_path: Path) -> None:
    since_start = 19_600  # days, fewer than from 1970 to the instants of these bags
    bags = [driven_joint(tmp_path / f"run{n}", n + 1, n - since_start) for n in range(2)]
    series = each(bags, tmp_path / "out")
    assert [row.cells["begun"] for row in series.rows] == ["", ""]
    assert "1970" not in (tmp_path / "out" / "index.html").read_text()
