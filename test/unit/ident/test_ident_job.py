from __future__ import annotations

import json
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_core.outputs import MARK, OutputError
from flexarm_ident import IdentificationError, IoData, job, read_bag
from flexarm_ident.job import identify_bags, model_in, model_name, whole
from flexarm_ident.models.files import load_model
from flexarm_ident.provenance import record_hash
from flexarm_ident.workflow.request import Request
from support.bag_samples import START_NS, io_sample, write_bag
from support.ident_systems import random_model, step_by_step

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

STEP_NS = 10_000_000
STAGES = (
    *("reading", "Hankel matrices", "subspace", "order", "fit", "friction", "refinement"),
    *("reduction", "validation", "writing"),
)
QUICK = Request(order=4, block_rows=10, method="orse", reduction="mrm", reduced_order=4)


def a_bag(path: Path, samples: int = 600, seed: int = 1) -> Path:
    """Write a bag of a system with 1 input and 2 outputs."""
    u = np.random.default_rng(seed).standard_normal((samples, 1))
    y = step_by_step(random_model(1, states=4, outputs=2, inputs=1), u)
    rows = enumerate(zip(u, y, strict=True))
    return write_bag(path, [io_sample(k + 1, START_NS + k * STEP_NS, *row) for k, row in rows])


@pytest.fixture
def short_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a line stand for the report, where its file matters and not what it shows."""
    monkeypatch.setattr(job, "render_report", lambda subject, **_: f"{subject.name} {MARK}\n")


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@given(
    st.lists(st.tuples(st.sampled_from([*STAGES, "another"]), st.floats(allow_nan=False))).map(
        lambda reports: [("reading", 0.0), *reports, ("writing", 1.0)]
    )
)
def test_whole___stages_in_any_order___reports_news_alone_and_never_goes_back(
    reports: list[tuple[str, float]],
) -> None:
    reported: list[tuple[str, float]] = []
    report = whole(lambda stage, done: reported.append((stage, done)))
    for stage, fraction in reports:
        report(stage, fraction)
    parts = [done for _, done in reported]
    stages = [stage for stage, _ in reported]
    assert list(dict.fromkeys(stages)) == list(dict.fromkeys(stage for stage, _ in reports))
    assert [stage for stage, _ in groupby(stages)] == list(dict.fromkeys(stages))
    assert parts == sorted(parts)
    assert len(set(reported)) == len(reported) <= 101 + len(STAGES)
    assert (parts[0], parts[-1]) == (0.0, 1.0)


def test_whole___stage_by_stage___each_has_a_share() -> None:
    parts: list[float] = []
    report = whole(lambda _, done: parts.append(done))
    for stage in STAGES:
        report(stage, 0.0)
        report(stage, 1.0)
    assert parts[::2] == [0.0, *parts[1:-1:2]]
    assert all(np.diff(parts[1::2]) > 0.0)


def a_record() -> IoData:
    columns = np.arange(12.0).reshape(6, 2)
    return IoData(
        columns[:, :1],
        columns,
        dt_s=0.01,
        inputs=("u",),
        outputs=("y", "z"),
        source="here",
        compensation=0.5 * columns[:, :1],
        reference=columns[:, 1],
    )


def one_bit_more(column: Any) -> Any:  # noqa: ANN401 - an array
    changed = column.copy()
    changed.flat[-1] = np.nextafter(changed.flat[-1], np.inf)
    return changed


@pytest.mark.parametrize(
    "change",
    [
        lambda record: {"u": one_bit_more(record.u)},
        lambda record: {"y": one_bit_more(record.y)},
        lambda record: {"compensation": one_bit_more(record.compensation)},
        lambda record: {"reference": one_bit_more(record.reference)},
        lambda record: {"dt_s": float(np.nextafter(record.dt_s, 1.0))},
        lambda _: {"inputs": ("v",)},
        lambda _: {"outputs": ("z", "y")},
        lambda _: {"compensation": None},
        lambda _: {"reference": None},
    ],
)
def test_record_hash___any_part_changed___is_another(
    change: Callable[[IoData], dict[str, Any]],
) -> None:
    assert record_hash(replace(a_record(), **change(a_record()))) != record_hash(a_record())


def test_record_hash___same_record_elsewhere___is_the_same() -> None:
    assert record_hash(replace(a_record(), source="there")) == record_hash(a_record())


@pytest.mark.parametrize(
    ("name", "expected"),
    [("c_dat3", "c_dat3"), ("run 1.mcap", "run_1"), ("a-b.c", "a_b"), ("ä", "ä")],
)
def test_model_name___bag___is_a_name_for_parameters(
    tmp_path: Path, name: str, expected: str
) -> None:
    assert model_name(tmp_path / name) == expected
    assert model_name(tmp_path / "inner" / ".." / name) == expected


@pytest.mark.slow
def test_identify_bags___two_bags___writes_one_model_with_its_origin(tmp_path: Path) -> None:
    bags = [a_bag(tmp_path / "first"), a_bag(tmp_path / "second", seed=2)]
    reported: list[tuple[str, float]] = []
    results = identify_bags(
        bags,
        tmp_path / "out" / "model",
        QUICK,
        exports=(".json", ".mat"),
        progress=lambda *report: reported.append(report),
    )

    assert (model_in(tmp_path / "out"), model_in(results.folder)) == ("", "first")
    assert results.name == "first"
    assert names_in(results.folder) == {"model.yaml", "model.json", "model.mat", "report.html"}
    assert names_in(tmp_path / "out") == {"model"}
    assert results.folder.stat().st_mode == (tmp_path / "out").stat().st_mode
    model = results.outcome.model
    for suffix in ("yaml", "json", "mat"):
        assert load_model(results.folder / f"model.{suffix}").A.tobytes() == model.A.tobytes()
    fields = json.loads((results.folder / "model.json").read_text(encoding="utf-8"))
    origin = fields["models"]["first"]
    assert origin["source"] == ["first", "second"]
    # Files are given away: they do not tell where they were made.
    for file in results.folder.iterdir():
        assert str(tmp_path).encode() not in file.read_bytes()
    assert origin["source_sha256"] == [record_hash(read_bag(bag)) for bag in bags]
    assert origin["method"] == "orse"
    assert Request(**json.loads(origin["request"]) | {"known_modes_hz": ()}) == QUICK
    assert f"numpy {np.__version__}" in origin["versions"]
    page = (results.folder / "report.html").read_text(encoding="utf-8")
    assert origin["hash"] in page
    assert "Written by the identification: model/model.yaml, model/model.json" in page
    assert {stage for stage, _ in reported} == set(STAGES) - {"order", "friction", "refinement"}
    assert (reported[0], reported[-1]) == (("reading", 0.0), ("writing", 1.0))


@pytest.mark.slow
@pytest.mark.usefixtures("short_report")
def test_identify_bags___again_into_the_same_folder___leaves_nothing_stale(tmp_path: Path) -> None:
    bag, out = a_bag(tmp_path / "run"), tmp_path / "out"
    identify_bags([bag], out, QUICK, exports=(".json", ".h"))
    (out / "notes.txt").write_text("mine")
    first = (out / "model.json").read_bytes()

    identify_bags([bag], out, QUICK, exports=(".json",))
    assert names_in(out) == {"model.yaml", "model.json", "report.html", "notes.txt"}
    assert (out / "model.json").read_bytes() == first

    identify_bags([bag], out, replace(QUICK, order=5, reduced_order=5))
    assert names_in(out) == {"model.yaml", "report.html", "notes.txt"}
    assert load_model(out / "model.yaml").nstates == 5


def refuse_to_read(*_: object) -> None:
    raise AssertionError("the work has begun")


@pytest.mark.parametrize("name", ["model.yaml", "model.h", "report.html"])
def test_identify_bags___file_of_somebody_else___is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    bag, out = a_bag(tmp_path / "run"), tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    monkeypatch.setattr(job, "read_record", refuse_to_read)
    with pytest.raises(OutputError, match=rf"out/{name}: was not written by flexarm.*--force"):
        identify_bags([bag], out, QUICK, exports=(".h",))
    assert names_in(out) == {name}
    assert (out / name).read_text() == "mine"


@pytest.mark.usefixtures("short_report")
def test_identify_bags___forced___replaces_what_it_writes_and_nothing_else(tmp_path: Path) -> None:
    bag, out = a_bag(tmp_path / "run"), tmp_path / "out"
    out.mkdir()
    for name in ("model.yaml", "model.h"):
        (out / name).write_text("mine")
    identify_bags([bag], out, QUICK, force=True)
    assert load_model(out / "model.yaml").nstates == 4
    assert (out / "model.h").read_text() == "mine"


@pytest.mark.usefixtures("short_report")
def test_identify_bags___format_that_is_not_asked_for___of_somebody_else_stays(
    tmp_path: Path,
) -> None:
    bag, out = a_bag(tmp_path / "run"), tmp_path / "out"
    out.mkdir()
    (out / "model.h").write_text("mine")
    identify_bags([bag], out, QUICK)
    identify_bags([bag], out, QUICK)
    assert (out / "model.h").read_text() == "mine"


@pytest.mark.usefixtures("short_report")
@pytest.mark.parametrize("stage", [each for each in STAGES if each not in {"order", "friction"}])
@pytest.mark.slow
def test_identify_bags___interrupted_at_any_stage___leaves_no_trace(
    tmp_path: Path, stage: str
) -> None:
    def interrupt(now: str, done: float) -> None:
        if now == stage and (stage != "writing" or done == 1.0):
            raise KeyboardInterrupt

    bag, request = a_bag(tmp_path / "run"), replace(QUICK, refine=True)
    with pytest.raises(KeyboardInterrupt):
        identify_bags([bag], tmp_path / "out", request, exports=(".mat",), progress=interrupt)
    assert names_in(tmp_path) == {"run"}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"reduced_order": 10}, "reduced_order = 10 needs a reduction: choose one of mrm, msv"),
        ({"update": "b"}, "update = b needs a reduction"),
        ({"reduction": "mrmc"}, "mrmc and known modes belong together"),
        ({"reduction": "mrm", "known_modes_hz": (9.4,)}, "mrmc and known modes belong together"),
        (
            {"reduction": "mrmc", "known_modes_hz": (9.4, float("nan"))},
            "a known mode of nan Hz: give the frequency as a positive number",
        ),
        ({"reduction": "mrmc", "known_modes_hz": (-9.4,)}, "a known mode of -9.4 Hz"),
        ({"reduction": "mrm", "reduced_order": 0}, "reduced_order = 0 is too small: 1 or more"),
        (
            {"reduction": "mrmc", "known_modes_hz": (9.4, 24.0), "reduced_order": 3},
            "reduced_order = 3 is too small: 4 or more",
        ),
        (
            {"reduction": "mrm", "order": 8, "reduced_order": 10},
            "reduced_order = 10 is more than order = 8: lower it, or raise the order or leave",
        ),
    ],
)
def test_request___what_contradicts_itself___is_refused_before_the_fit(
    fields: dict[str, Any], message: str
) -> None:
    with pytest.raises(IdentificationError, match=message):
        Request(**fields)
