from __future__ import annotations

import math
import operator
import os
import time
from typing import TYPE_CHECKING, Any

import distributed
import pytest

from flexarm_core.workers import Workers
from reproduction.contents import all_subjects
from reproduction.framework import computing
from reproduction.framework.computing import Outcome, Store, reproduce
from reproduction.framework.findings import Call, Finding, ReproductionError, Subject
from reproduction.framework.selection import page_of, select
from reproduction.framework.verdicts import Judgement, Verdict

if TYPE_CHECKING:
    from pathlib import Path

    from reproduction.framework.findings import Results

HERE = Workers(jobs=1)
KEYS = ("table-2-1", "table-2-10", "table-3-1a", "figure-2-2", "appendix-b", "appendix-b-1")


def finding(words: str) -> Finding:
    return Finding(Judgement(Verdict.AGREES, words))


def subject(key: str, *needs: Call) -> Subject:
    """Make one whose finding says the results of its computations."""

    def build(results: Results) -> Finding:
        return finding(" ".join(str(results[call]) for call in needs))

    return Subject(key, key, needs, build)


def said(outcome: Outcome) -> str:
    assert outcome.finding is not None, outcome.failure
    return outcome.finding.judgement.because


SUBJECTS = tuple(subject(key) for key in KEYS)


def test_reproduce___results___reach_the_subjects_that_need_them(tmp_path: Path) -> None:
    root, power = Call(math.sqrt, (9.0,)), Call(operator.pow, (2, 5))
    wanted = [subject("table-2-1", root, power), subject("table-2-2", root)]
    outcomes = reproduce(wanted, Store(tmp_path), workers=HERE)
    assert [said(each) for each in outcomes] == ["3.0 32", "3.0"]


def test_reproduce___call_that_two_need___is_computed_once_and_never_again(tmp_path: Path) -> None:
    # A folder cannot be made twice.
    call = Call(os.mkdir, (str(tmp_path / "made"),))
    wanted = [subject("table-2-1", call), subject("table-2-2", call)]
    for _ in range(2):
        outcomes = reproduce(wanted, Store(tmp_path / "cache"), workers=HERE)
        assert [said(each) for each in outcomes] == ["None", "None"]


def test_reproduce___interrupted___goes_on_from_there(tmp_path: Path) -> None:
    calls = [Call(os.mkdir, (str(tmp_path / f"made{k}"),)) for k in range(4)]
    store = Store(tmp_path / "cache")
    wanted = [subject("table-2-1", *calls)]

    def interrupt(_text: str, part: float) -> None:
        if part >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reproduce(wanted, store, workers=HERE, progress=interrupt)
    kept = store.find(calls)
    assert len(kept) == 2
    assert not list((tmp_path / "cache").glob("*.part"))
    # What was under way when the interrupt came is lost: let it be made again.
    for call in set(calls) - set(kept):
        if os.path.isdir(call.arguments[0]):  # noqa: PTH112 - the name as the call has it
            os.rmdir(call.arguments[0])  # noqa: PTH106
    assert said(reproduce(wanted, store, workers=HERE)[0]) == "None None None None"


def test_reproduce___failing_call___takes_only_those_with_it_that_need_it(tmp_path: Path) -> None:
    wrong, right = Call(operator.truediv, (1, 0)), Call(math.sqrt, (4.0,))
    store = Store(tmp_path)
    wanted = [subject("table-2-1", right, wrong), subject("table-2-2", right)]
    failed, fine = reproduce(wanted, store, workers=HERE)
    assert failed.finding is None
    assert failed.failure == "_operator.truediv(1, 0): ZeroDivisionError: division by zero"
    assert said(fine) == "2.0"
    assert store.find([wrong, right]) == {right: 2.0}


def test_reproduce___failing_build___is_one_line_and_the_others_go_on(tmp_path: Path) -> None:
    def broken(_results: Results) -> Finding:
        raise ValueError("no\nfigures")

    wanted = [Subject("table-2-1", "", (), broken), subject("table-2-2", Call(math.sqrt, (4.0,)))]
    outcomes = reproduce(wanted, Store(tmp_path), workers=HERE)
    assert outcomes[0].failure == "ValueError: no figures"
    assert said(outcomes[1]) == "2.0"


def test_reproduce___subject_that_does_not_name_what_it_uses___fails(tmp_path: Path) -> None:
    call = Call(math.sqrt, (4.0,))
    sly = Subject("table-2-2", "", (), lambda results: finding(str(results[call])))
    outcomes = reproduce([subject("table-2-1", call), sly], Store(tmp_path), workers=HERE)
    assert outcomes[1].failure.startswith("KeyError")


def test_reproduce___progress___ends_at_one_and_never_falls(tmp_path: Path) -> None:
    shown: list[tuple[str, float]] = []
    calls = [Call(math.sqrt, (float(k),)) for k in range(5)]
    wanted = [subject("table-2-1", *calls), subject("table-2-2", Call(operator.truediv, (1, 0)))]
    reproduce(wanted, Store(tmp_path), workers=HERE, progress=lambda *now: shown.append(now))
    for text in ("computing", "comparing"):
        parts = [part for name, part in shown if name == text]
        assert parts == sorted(parts)
        assert parts[-1] == 1.0


def test_reproduce___two_jobs___compute_in_other_processes(tmp_path: Path) -> None:
    calls = [Call(os.getpid), Call(time.sleep, (0.0,)), Call(operator.truediv, (1, 0))]
    wanted = [subject(f"table-2-{k}", call) for k, call in enumerate(calls)]
    outcomes = reproduce(wanted, Store(tmp_path), workers=Workers(jobs=2))
    assert int(said(outcomes[0])) != os.getpid()
    assert said(outcomes[1]) == "None"
    assert "ZeroDivisionError" in outcomes[2].failure


def test_reproduce___worker_with_another_source___gives_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    digests = iter(("of the caller", "of the worker"))
    monkeypatch.setattr(computing, "source_digest", lambda: next(digests))
    (outcome,) = reproduce(
        [subject("table-2-1", Call(math.sqrt, (4.0,)))], Store(tmp_path), workers=HERE
    )
    assert "another source" in outcome.failure


@pytest.mark.slow
@pytest.mark.exhaustive
def test_reproduce___dask___computes_on_the_cluster(tmp_path: Path) -> None:
    calls = [Call(math.sqrt, (float(k),)) for k in range(20)]
    wanted = [
        subject("table-2-1", *calls),
        subject("table-2-2", Call(os.getpid)),
        subject("table-2-3", Call(operator.truediv, (1, 0))),
    ]
    local_cluster: Any = distributed.LocalCluster
    with local_cluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        workers = Workers(dask=cluster.scheduler_address)
        roots, process, failed = reproduce(wanted, Store(tmp_path), workers=workers)
    assert said(roots) == " ".join(str(math.sqrt(k)) for k in range(20))
    assert int(said(process)) != os.getpid()
    assert "ZeroDivisionError" in failed.failure


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        (["table-2-1"], ["table-2-1"]),
        (["TABLE-2-10 "], ["table-2-10"]),
        (["table-2-*"], ["table-2-1", "table-2-10"]),
        (["table-2"], ["table-2-1", "table-2-10"]),
        (["appendix-b"], ["appendix-b", "appendix-b-1"]),
        (["chapter-2"], ["table-2-1", "table-2-10", "figure-2-2"]),
        (["appendices", "table-3-1a"], ["table-3-1a", "appendix-b", "appendix-b-1"]),
        (["all", "table-2-1"], list(KEYS)),
    ],
)
def test_select___words___mean_the_subjects(wanted: list[str], found: list[str]) -> None:
    assert [each.key for each in select(SUBJECTS, wanted)] == found


def test_select___unknown_key___names_what_is_near_in_one_line() -> None:
    with pytest.raises(ReproductionError) as caught:
        select(SUBJECTS, ["table-2-1", "tabel-3-1a"])
    message = str(caught.value)
    assert "'tabel-3-1a'" in message
    assert "table-3-1a" in message
    assert "--list" in message
    assert "\n" not in message


def test_select___nothing_near___still_says_how_to_find_out() -> None:
    with pytest.raises(ReproductionError, match="--list"):
        select(SUBJECTS, ["zzz"])


@pytest.mark.parametrize("key", ["table", "table-2-", "graph-2-1", "table-2-1-1", ""])
def test_page_of___no_key___is_refused(key: str) -> None:
    with pytest.raises(ReproductionError, match="no key"):
        page_of(key)


def test_all_subjects___the_thesis___stand_in_its_order() -> None:
    keys = [each.key for each in all_subjects()]
    pages = list(dict.fromkeys(map(page_of, keys)))
    assert pages == ["chapter-2", "chapter-3", "chapter-4", "appendices", "sensitivity"]
    wanted = [f"table-2-{n}" for n in range(1, 7)]
    assert [key for key in keys if key.startswith("table-2-")] == wanted
    last_of_chapter_2 = [key for key in keys if page_of(key) == "chapter-2"][-1]
    assert last_of_chapter_2 == "choice-2-2"
