"""Files that demo and design find in their folders, without any node."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.simulated import demo as program
from flexarm_bringup.verbs.simulated import design, node_run
from flexarm_core.outputs import MARK, OutputError

if TYPE_CHECKING:
    from pathlib import Path

    import click
    from click.testing import Result


class Started(Exception):  # noqa: N818 - no error: the nodes would start now
    """The demo has begun to work."""


@pytest.fixture(autouse=True)
def _no_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(*_: object, **__: object) -> None:
        raise Started

    monkeypatch.setattr(node_run, "running_graph", start)


def demo(out: Path, *more: str) -> Result:
    return CliRunner().invoke(program.demo, ["--fast", "--out", str(out), *more])


@pytest.mark.parametrize(
    "name",
    ["report.html", "summary.json", "models/experiment/model.yaml", "bag/mine.mcap", "bag"],
)
@pytest.mark.parametrize("keep", [(), ("--keep-bag",)])
def test_demo___what_it_did_not_write___is_refused_before_the_nodes_start(
    tmp_path: Path, name: str, keep: tuple[str, ...]
) -> None:
    mine = tmp_path / name
    mine.parent.mkdir(parents=True, exist_ok=True)
    mine.write_text("mine")
    refused = demo(tmp_path, *keep)
    assert isinstance(refused.exception, OutputError), refused.output
    assert str(tmp_path / name.split("/mine", maxsplit=1)[0]) in str(refused.exception)
    assert "--force" in str(refused.exception)
    assert mine.read_text() == "mine"


def test_demo___bags_that_were_kept___stay_until_forced(tmp_path: Path) -> None:
    assert isinstance(demo(tmp_path, "--keep-bag").exception, Started)
    kept = tmp_path / "bag" / "experiment"
    kept.mkdir()
    for again in ((), ("--keep-bag",)):
        assert isinstance(demo(tmp_path, *again).exception, OutputError)
        assert kept.exists()
    assert isinstance(demo(tmp_path, "--force").exception, Started)
    assert not kept.exists()


def test_demo___bags_of_a_run_that_was_killed___are_removed(tmp_path: Path) -> None:
    left_over = tmp_path / "bag" / "experiment"
    left_over.mkdir(parents=True)
    (tmp_path / "bag" / ".flexarm").write_text(MARK)
    assert isinstance(demo(tmp_path).exception, Started)
    assert not (tmp_path / "bag").exists()


def test_demo___log_of_an_earlier_run___is_kept(tmp_path: Path) -> None:
    (tmp_path / "nodes.log").write_text("mine")
    assert isinstance(demo(tmp_path).exception, Started)
    assert (tmp_path / "nodes.log").read_text() == "mine"


@pytest.mark.parametrize("verb", [program.demo, design.design])
def test_live___page_beside_the_nodes___looks_on_and_changes_no_other_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: click.Command
) -> None:
    started: list[tuple[dict[str, Any], tuple[str, ...]]] = []

    def start(parameters: dict[str, Any], _: Path, *, nodes: tuple[str, ...], **__: object) -> None:
        started.append((parameters, nodes))
        raise Started

    monkeypatch.setattr(node_run, "running_graph", start)
    for more in ((), ("--live",)):
        ended = CliRunner().invoke(verb, ["--fast", "--out", str(tmp_path), *more])
        assert isinstance(ended.exception, Started), ended.output
    (without, nodes), (live, more_nodes) = started
    assert more_nodes == (*nodes, "live")
    assert live["live"]["view_only"] is True
    assert [live.get(name) for name in nodes] == [without.get(name) for name in nodes]


@pytest.mark.parametrize("name", ["report.html", "summary.json", "controller.yaml"])
def test_design___what_it_did_not_write___is_refused_before_the_nodes_start(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_text("mine")
    refused = CliRunner().invoke(design.design, ["--fast", "--out", str(tmp_path)])
    assert isinstance(refused.exception, OutputError), refused.output
    assert (tmp_path / name).read_text() == "mine"
