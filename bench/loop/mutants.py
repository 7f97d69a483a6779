"""Mutants: small defects planted in the modules that guard the drive and the records.

mutmut plants them, one at a time, in a copy of the checkout: an operator, a number or a word is
another one, or something of `bench.loop.mutation_kinds`. The unit tests of the modules must fail on
each. Some mutants do the same as the original, so that no test can; the terminal shows every one
that lived.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from fnmatch import fnmatch
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bench.tools import (
    FAULTS_PAGE,
    count_option,
    json_option,
    make_table,
    write_json,
    write_table,
)
from flexarm_bringup.console import terminal

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

_ROOT = Path(__file__).parents[2]
_LAWS = ("pdpc", "ilqr", "lqg", "switching")
_BAGS = ("writer", "repair", "bounds", "check")
_PAGE = ("access", "requests")
SUBJECTS = {
    "limiter": ("flexarm_daq.loop.limiter.*",),
    "commander": ("flexarm_daq.loop.commander.*",),
    "watchdog": ("flexarm_daq.loop.watchdog.*",),
    "states of the drive": ("flexarm_daq.loop.safety.*",),
    "sequence numbers": ("flexarm_bags.sequence.*",),
    "checksums": (
        "flexarm_bags.records.layout.x_summary_of__*",
        "flexarm_bags.records.layout.x_chunk_content__*",
        *(f"flexarm_bags.mcap_check.*_{part}__*" for part in ("attachment", "data_end", "footer")),
    ),
    "units": ("flexarm_core.channels.*",),
    "margins": ("flexarm_control.design.margins.*",),
    "laws": tuple(f"flexarm_control.laws.{name}.*" for name in _LAWS),
    "bags": tuple(f"flexarm_bags.{name}.*" for name in _BAGS),
    "page": tuple(f"flexarm_live.serving.{name}.*" for name in _PAGE),
}
"""Patterns of the functions by subject, as mutmut names them."""
MODULES = (
    *(f"flexarm_daq/loop/{name}.py" for name in ("limiter", "commander", "watchdog", "safety")),
    *(f"flexarm_bags/{name}.py" for name in ("sequence", "records/layout", "mcap_check")),
    "flexarm_core/channels.py",
    "flexarm_control/design/margins.py",
    *(f"flexarm_control/laws/{name}.py" for name in _LAWS),
    *(f"flexarm_bags/{name}.py" for name in _BAGS),
    *(f"flexarm_live/serving/{name}.py" for name in _PAGE),
)
"""Files of these functions."""
_HEADS = ("subject", "mutants", "killed", "score")
_TESTS = (
    *(f"test/unit/daq/loop/test_daq_{name}.py" for name in ("limiter", "commander", "watchdog")),
    *(f"test/unit/daq/loop/test_daq_{name}.py" for name in ("safety", "command_age")),
    *(f"test/unit/bags/test_bags_{name}.py" for name in ("sequence", "checksums")),
    "test/unit/core/test_core_channels.py",
    "test/unit/control/design/test_control_margins.py",
    "test/unit/control/laws",
    *(
        f"test/unit/bags/test_bags_{name}.py"
        for name in ("bounds", "check", "cut_chunks", "repair")
    ),
    *(
        f"test/unit/bags/test_bags_{name}.py"
        for name in ("recording", "recording_survives", "split")
    ),
    *(f"test/unit/live/serving/test_live_{name}.py" for name in ("hostile", "requests", "server")),
)
LEAST_SCORE = 0.9
# mutmut names a module by its path below `src`, and no ROS is needed for these tests.
_SETTINGS = """\
[tool.mutmut]
source_paths = ["src"]
also_copy = ["docs"]
only_mutate = {modules}
pytest_add_cli_args = ["-p", "no:xdist", "-p", "no:cacheprovider", "-x", "--hypothesis-seed=0"]
pytest_add_cli_args_test_selection = {tests}

[tool.pytest.ini_options]
pythonpath = ["src", "test"]
addopts = "--import-mode=importlib"
markers = ["slow", "system"]
"""
_KILLED = ("killed", "timeout", "caught by type check")


@dataclass(frozen=True)
class Score:
    """Mutants of one subject; `lived` are the names of those that no test failed on."""

    subject: str
    mutants: int
    lived: tuple[str, ...]

    @property
    def killed(self) -> int:
        """Mutants that a test failed on."""
        return self.mutants - len(self.lived)


@click.command()
@count_option("--jobs", 2)
@click.option(
    "--subject",
    "subjects",
    multiple=True,
    type=click.Choice([*SUBJECTS]),
    help="This one alone; may be given more than once.",
)
@json_option
@click.option("--docs", is_flag=True, help="Write the section of docs/faults.md.")
def main(*, jobs: int, subjects: tuple[str, ...], json_file: Path | None, docs: bool) -> None:
    """Plant mutants, run the tests on each, and print what lived; exit code 1 below 90 %."""
    if find_spec("mutmut") is None:
        raise click.ClickException(
            "no mutmut: ./flexarm exec python -m pip install -r requirements/mutants.in"
        )
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        _copy_checkout(folder)
        chosen = subjects or tuple(SUBJECTS)
        patterns = [pattern for each in chosen for pattern in SUBJECTS[each]]
        _mutmut(folder, "run", "--max-children", str(jobs), *patterns)
        scores = list(_scores(_states(folder), chosen))
        for name in (name for score in scores for name in score.lived):
            terminal.CONSOLE.print(_mutmut(folder, "show", name, capture=True))
    table, rows = make_table(*_HEADS), list(_rows(scores))
    for row in rows:
        table.add_row(*row)
    terminal.show_table(table)
    write_json(json_file, scores)
    if docs:
        write_table(FAULTS_PAGE, "mutants", _HEADS, rows)
    killed = sum(score.killed for score in scores)
    sys.exit(0 if killed >= LEAST_SCORE * sum(score.mutants for score in scores) else 1)


def _copy_checkout(folder: Path) -> None:
    """Copy what the tests need, with the packages side by side."""
    for package in (_ROOT / "src").iterdir():
        inner = package / package.name
        source = inner if inner.is_dir() else package
        shutil.copytree(source, folder / "src" / package.name)
    for name in ("test", "docs"):
        shutil.copytree(_ROOT / name, folder / name)
    modules = [f"src/{module}" for module in MODULES]
    settings = _SETTINGS.format(modules=modules, tests=list(_TESTS))
    (folder / "pyproject.toml").write_text(settings, "utf-8")


def _mutmut(folder: Path, *words: str, capture: bool = False) -> str:
    done = subprocess.run(  # noqa: S603 - a tool of ours
        [sys.executable, "-m", "bench.loop.mutation_kinds", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(_ROOT), *sys.path[1:]])},
        check=False,
        text=True,
        stdout=subprocess.PIPE if capture else None,
    )
    if done.returncode:
        raise click.ClickException(f"mutmut {words[0]} ended with exit code {done.returncode}")
    return done.stdout or ""


def _states(folder: Path) -> dict[str, str]:
    """Return what became of each mutant, by its name."""
    lines = _mutmut(folder, "results", "--all", "true", capture=True).splitlines()
    pairs = (line.strip().partition(": ") for line in lines)
    return {name: state for name, _, state in pairs if state}


def _scores(states: Mapping[str, str], subjects: Sequence[str]) -> Iterator[Score]:
    for subject in subjects:
        patterns = SUBJECTS[subject]
        own = [name for name in states if any(fnmatch(name, pattern) for pattern in patterns)]
        lived = tuple(name for name in own if states[name] not in _KILLED)
        yield Score(subject, len(own), lived)


def _rows(scores: Sequence[Score]) -> Iterator[tuple[str, ...]]:
    total = Counter[str]()
    for score in scores:
        total.update(mutants=score.mutants, killed=score.killed)
        yield score.subject, *_cells(score.mutants, score.killed)
    yield "all", *_cells(total["mutants"], total["killed"])


def _cells(mutants: int, killed: int) -> tuple[str, str, str]:
    return str(mutants), str(killed), f"{100.0 * killed / mutants:.1f} %" if mutants else ""


if __name__ == "__main__":
    main()
