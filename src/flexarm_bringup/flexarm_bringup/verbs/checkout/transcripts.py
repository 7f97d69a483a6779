"""Run of the commands that a page shows, in a folder of their own."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from flexarm_bringup.verbs.checkout.pages import (
    Step,
    differences,
    drawn_alike,
    folders,
    steps,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_END_S = 30.0
_FIRST_DOMAIN, _DOMAINS = 10, 80
_ERROR = "flexarm: "
"""Beginning of a line that a page shows of a command that fails."""


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
