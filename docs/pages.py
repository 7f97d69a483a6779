"""Program of the verb `docs`: site of the pages that works offline, and a run of what they show.

A block of code with `$ COMMAND` lines is run as it stands; the lines below a command are its
output, where the page may leave lines out. Comments of Markdown before a block say the rest:

- `output of: COMMAND`: the whole block is the output of a command,
- `file: NAME`: the block is a file, for the commands after it,
- `together until: WORDS`: its commands run side by side until the last one prints a line with the
  words, and get Ctrl-C then,
- `not run: REASON`: the block is left alone.

`drawn by: COMMAND` before a picture draws it anew: the name of a file is added to the command.
`folder: PATH` anywhere gives the page's commands the files of a folder of the checkout.
"""

from __future__ import annotations

import gc
import io
import logging
import os
import re
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE, VerbGroup, examples
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.checkout.checks import EXAMPLES, passes
from flexarm_bringup.verbs.checkout.folder import checkout
from flexarm_core.outputs import MARK, is_replaceable

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_MANY_OBJECTS = 1_000_000
_BUILD = ".buildinfo"
"""File that Sphinx writes with a site."""
_TOOLS = ("sphinx", "myst_parser", "furo", "sphinx_copybutton")
"""What Sphinx is asked for in `docs/conf.py`."""
_NOT_REPRODUCED = """\
# The thesis, reproduced

Not in this checkout. `./flexarm reproduce all -o docs/reproduction` makes it.
"""
_END_S = 30.0
_FIRST_DOMAIN, _DOMAINS = 10, 80
_ERROR = "flexarm: "
"""Beginning of a line that a page shows of a command that fails."""
_BLOCK = re.compile(
    r"^<!-- drawn by: (?P<drawn>.+?) -->\n+!\[[^\]]*\]\((?P<picture>[^)]+)\)"
    r"|(?:^<!-- (?P<mark>output of|file|together until|not run)(?:: (?P<said>[^\n]*?))? -->\n+)?"
    r"(?:^(?P<fence> *```)(?P<language>[^\n`]*)\n(?P<fenced>.*?)^ *```$"
    r"|(?P<indented>(?:^ {4,}\S[^\n]*\n(?:^ *\n(?= {4}))*)+))",
    re.MULTILINE | re.DOTALL,
)
_FOLDER = re.compile(r"^<!-- folder: (.+) -->$", re.MULTILINE)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)")
_PLACE = re.compile(r"-?\d+(?:\.\d+)?")
_IDENTITY = re.compile(r"[mp][0-9a-f]{10}")
_POINT = 1.0
_GAP = "..."
_LAST_DIGITS = 2
_RELATIVE = 0.01
# Counts are the same on every processor, but for a few messages of a run in real time.
_RELATIVE_OF_COUNTS = 0.001


@click.group(cls=VerbGroup, context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Give this program the usage, error lines and exit codes of the command `flexarm`."""


@main.command("docs")
@click.argument("pages", nargs=-1, type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/docs"),
    show_default=True,
    help="Folder of the site.",
)
@FORCE
@examples("docs", "docs docs/tutorial.md")
def docs(pages: tuple[Path, ...], out: Path, *, force: bool) -> None:
    """Build the pages as a site, and run what they show.

    Runs the examples and the commands of all pages, compares the outputs and figures with those
    that the pages show, and builds the site, which works offline. With PAGES, only their commands
    are run, and nothing is built.
    """
    root = checkout("pages")
    hold = bool(pages) or passes("examples", EXAMPLES, root)
    for page in [page.resolve() for page in pages] or _pages(root):
        terminal.step(f"commands: {page.relative_to(root)}")
        for line in outdated(root, page):
            hold = False
            terminal.CONSOLE.print(line)
    if not pages:
        terminal.step(f"site: {out / 'index.html'}")
        if warnings := build_site(root, out, force=force):
            hold = False
            terminal.CONSOLE.print(warnings)
    sys.exit(0 if hold else 1)


def _pages(root: Path) -> list[Path]:
    """Return the pages with commands that are run."""
    written = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    return [page for page in written if next(steps(page.read_text("utf-8")), None) is not None]


def build_site(root: Path, out: Path, *, force: bool = False) -> str:
    """Build the site from a checkout, in place of an older one; return the warnings, a line each.

    Raises
    ------
    LaunchError
        Without Sphinx or what it is asked for, or when `out` holds something else than a site of
        ours and `force` is not set.
    """
    if missing := [tool for tool in _TOOLS if find_spec(tool) is None]:
        raise LaunchError(f"no module {', '.join(missing)}: install requirements/dev.in")
    from sphinx.cmd.build import build_main  # noqa: PLC0415 - it may be missing, and takes long

    if out.exists() and any(out.iterdir()) and not (force or _is_site(out)):
        raise LaunchError(
            f"{out} holds something else than a site of flexarm: choose another folder, or replace "
            "all in it with --force"
        )
    with TemporaryDirectory(prefix="flexarm-docs-") as scratch:
        pages, site = Path(scratch, "docs"), Path(scratch, "site")
        # Sphinx writes the pages of the reference beside the others.
        shutil.copytree(root / "docs", pages)
        Path(scratch, "src").symlink_to(root / "src")
        if not (pages / "reproduction").exists():
            (pages / "reproduction").mkdir()
            (pages / "reproduction" / "index.md").write_text(_NOT_REPRODUCED, "utf-8")
        with _at_work(), redirect_stderr(io.StringIO()) as said:
            build_main(["-b", "html", "-q", "-N", str(pages), str(site)])
        if (site / _BUILD).is_file():
            words = (site / _BUILD).read_text("utf-8")
            (site / _BUILD).write_text(f"# {MARK}\n{words}", "utf-8")
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(site, out, ignore=shutil.ignore_patterns(".doctrees"))
    return said.getvalue().replace(f"{pages}/", "docs/")


@contextmanager
def _at_work() -> Iterator[None]:
    """Let Sphinx make no records below warnings, and look for garbage when there is some.

    It holds all pages as trees until its end: a look over them finds nothing.
    """
    often = gc.get_threshold()
    gc.set_threshold(_MANY_OBJECTS, *often[1:])
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)
        gc.set_threshold(*often)


def _is_site(folder: Path) -> bool:
    build = folder / _BUILD
    return build.is_file() and is_replaceable(build)


def outdated(root: Path, page: Path) -> Iterator[str]:
    """Run the commands of a page; yield what it shows and they do not print, as they end.

    They run one after the other in a scratch folder, which has the files of the checkout without
    its `out`.
    """
    text = page.read_text("utf-8")
    with TemporaryDirectory(prefix="flexarm-page-") as scratch:
        folder = Path(scratch)
        for entry in root.iterdir():
            if entry.name != "out":
                (folder / entry.name).symlink_to(entry)
        for named in folders(text):
            shutil.copytree(root / named, folder, dirs_exist_ok=True)
        for step in steps(text):
            if step.file:
                (folder / step.file).write_text(step.text, "utf-8")
                continue
            name = f"{page.relative_to(root)}:{step.line}: {step.commands[0]}"
            if step.picture:
                yield from _otherwise(step, folder, page, root)
            else:
                yield from (f"{name}: {each}" for each in _wrong(step, folder))


def _otherwise(step: Step, folder: Path, page: Path, root: Path) -> Iterator[str]:
    """Draw a picture anew; yield that it is another one."""
    shown = page.parent / step.picture
    drawn = folder / shown.name
    again = Step(step.line, (f"{step.commands[0]} {drawn.name}",))
    name = f"{page.relative_to(root)}:{step.line}"
    yield from (f"{name}: {each}" for each in _wrong(again, folder))
    if drawn.exists() and not (
        shown.exists() and drawn_alike(shown.read_text("utf-8"), drawn.read_text("utf-8"))
    ):
        new = root / "out" / "figures" / shown.name
        new.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(drawn, new)
        yield (
            f"{name}: another picture now: look at {new}, and copy it to {shown.relative_to(root)}"
        )


def _wrong(step: Step, folder: Path) -> Iterator[str]:
    # Away from the graphs that run on this machine.
    environment = {**os.environ, "ROS_DOMAIN_ID": str(_FIRST_DOMAIN + os.getpid() % _DOMAINS)}
    if step.until:
        yield from _together(step, folder, environment)
        return
    running = _started(step.commands[0], folder, environment, subprocess.PIPE)
    printed, _ = running.communicate()
    fails = any(line.strip().startswith(_ERROR) for line in step.shown)
    if (running.returncode != 0) != fails:
        end = "\n    ".join(printed.strip().splitlines()[-3:])
        yield f"exit code {running.returncode}\n    {end}"
    # A page is of no folder.
    yield from differences(step.shown, printed.replace(f"{folder}/", ""))


def _together(step: Step, folder: Path, environment: Mapping[str, str]) -> Iterator[str]:
    """Run commands side by side until the last says its words, and interrupt them."""
    outputs = [subprocess.DEVNULL] * (len(step.commands) - 1) + [subprocess.PIPE]
    # `exec`: the signal is for the command, not for the shell that started it.
    running = [
        _started(f"exec {command}", folder, environment, output)
        for command, output in zip(step.commands, outputs, strict=True)
    ]
    said = running[-1].stdout
    try:
        if said is not None and not any(step.until in line for line in said):
            yield f"ended without {step.until!r}"
    finally:
        for each in running:
            each.send_signal(signal.SIGINT)
        for each in running:
            each.communicate(timeout=_END_S)


def _started(
    command: str, folder: Path, environment: Mapping[str, str], output: int
) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603 - a command of our own pages
        ["/bin/bash", "-c", command],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT if output == subprocess.PIPE else output,
        text=True,
        encoding="utf-8",
    )


@dataclass(frozen=True)
class Step:
    """What a page asks for: a file to write, or commands to run and what it shows of them.

    Attributes
    ----------
    line : int
        Line of the page where it begins, from 1.
    commands : tuple of str
        Commands for a shell, which run side by side; none: a file is written.
    shown : tuple of str
        Lines of the output, of one command only.
    file, text : str
        Name and content of a file.
    picture : str
        Path, seen from the page, of a picture that the command draws.
    until : str
        Words in the output of the last command, after which all of them are interrupted.
    """

    line: int
    commands: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()
    file: str = ""
    text: str = ""
    picture: str = ""
    until: str = ""


def folders(page: str) -> list[str]:
    """Return the folders of the checkout whose files a page works on."""
    return _FOLDER.findall(page)


def steps(page: str) -> Iterator[Step]:
    """Yield what a page runs and writes, in its order."""
    for block in _BLOCK.finditer(page):
        mark, said = block["mark"], block["said"] or ""
        line, text = _content(page, block)
        if block["drawn"]:
            yield Step(line, (block["drawn"],), picture=block["picture"])
        elif mark == "file":
            yield Step(line, file=said, text=text)
        elif mark == "together until":
            yield Step(line, tuple(command for _, command in typed(text)), until=said)
        elif mark == "output of":
            yield Step(line, (said,), tuple(text.splitlines()))
        elif mark is None and not block["language"]:
            yield from _described(text, line)


def typed(block: str) -> list[tuple[int, str]]:
    """Return the commands that a block is made of, without remarks, and the line of each from 0."""
    found: list[tuple[int, str]] = []
    goes_on = False
    for number, line in enumerate(block.splitlines()):
        words = re.split(r" {2,}# ", line.strip().removeprefix("$ "))[0].rstrip()
        if goes_on:
            start, before = found[-1]
            found[-1] = (start, f"{before.removesuffix(chr(92)).rstrip()} {words}")
        elif words:
            found.append((number, words))
        goes_on = words.endswith("\\")
    return found


def plain_blocks(page: str) -> Iterator[tuple[int, str]]:
    """Yield the commands without a prompt of a page, and the line of each from 1."""
    for block in _BLOCK.finditer(page):
        first, text = _content(page, block)
        shell = block["mark"] in (None, "together until") and not block["language"]
        if shell and not re.search(r"^ *\$ ", text, re.MULTILINE):
            for number, command in typed(text):
                yield first + number, command


def _content(page: str, block: re.Match[str]) -> tuple[int, str]:
    """Return the line on which the content of a block begins, from 1, and the content."""
    part = next(part for part in ("indented", "fenced", "drawn") if block[part] is not None)
    return page.count("\n", 0, block.start(part)) + 1, "" if part == "drawn" else block[part]


def _described(text: str, line: int) -> Iterator[Step]:
    """Yield the commands with a prompt of a block, each with the lines below it."""
    lines = text.splitlines()
    starts = [number for number, each in enumerate(lines) if each.lstrip().startswith("$ ")]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=False):
        last = start
        while lines[last].endswith("\\"):
            last += 1
        ((_, command),) = typed("\n".join(lines[start : last + 1]))
        yield Step(line + start, (command,), tuple(lines[last + 1 : end]))


def differences(shown: tuple[str, ...], printed: str) -> list[str]:
    """Return the shown lines that are not in an output, in their order, and what is there instead.

    A line may be wrapped elsewhere. `...` stands for anything that is left out; lines may be left
    out without it. Numbers agree within two of their last digit, or 1 %: processors round
    differently. Whole numbers agree within two, or 0.1 %.
    """
    output = " ".join(printed.split())
    place, missing = 0, []
    for line in shown:
        words = line.split()
        while words and words[-1] == _GAP:
            words.pop()
        if not words:
            continue
        near = ""
        for found in _pattern(words).finditer(output, place):
            if _agree(words, found[0]):
                place = found.end()
                break
            near = near or found[0]
        else:
            missing.append(line.strip() + (f"\n    now: {near}" if near else ""))
    return missing


def _pattern(words: list[str]) -> re.Pattern[str]:
    """Return what the words look like with any numbers."""
    parts = [
        r".*?" if word == _GAP else _NUMBER.pattern.join(map(re.escape, _NUMBER.split(word)))
        for word in words
    ]
    return re.compile(r"(?<!\S)" + " ".join(parts).replace(" .*? ", " .*? ?") + r"(?!\S)")


def _agree(words: list[str], printed: str) -> bool:
    wanted, there = _NUMBER.findall(" ".join(words)), _NUMBER.findall(printed)
    if _GAP in words:
        head = len(_NUMBER.findall(" ".join(words[: words.index(_GAP)])))
        tail = len(wanted) - head
        there = there[:head] + there[len(there) - tail :]
    return len(wanted) == len(there) and all(map(_close, wanted, there))


def _close(shown: str, printed: str) -> bool:
    mantissa, _, power = shown.partition("e")
    last_digit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    is_count = shown.lstrip("+-").isdigit() and printed.lstrip("+-").isdigit()
    relative = _RELATIVE_OF_COUNTS if is_count else _RELATIVE
    return abs(float(printed) - float(shown)) <= 1e-9 + max(
        _LAST_DIGITS * last_digit, relative * abs(float(shown))
    )


def drawn_alike(first: str, second: str) -> bool:
    """Return whether two pictures in SVG have the same parts, at places less than a point apart."""
    words = [_PLACE.split(_IDENTITY.sub("", svg)) for svg in (first, second)]
    places = [
        [float(each) for each in _PLACE.findall(_IDENTITY.sub("", svg))] for svg in (first, second)
    ]
    return words[0] == words[1] and all(
        abs(one - other) < _POINT for one, other in zip(*places, strict=True)
    )


if __name__ == "__main__":
    main(["docs", *sys.argv[1:]], prog_name="flexarm")
