"""Command lines that do in a terminal what a page asks for."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_control.laws.registry import LAWS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_COMMAND = "./flexarm"


def record_line(bag: Path) -> str:
    """Return the command line of a record."""
    return shlex.join([_COMMAND, "record", shown(bag)])


def identify_line(bag: Path, folder: Path, request: Mapping[str, Any]) -> str:
    """Return the command line of an identification.

    Parameters
    ----------
    bag : Path
        Record.
    folder : Path
        Folder of the results.
    request : mapping
        Fields of a `Request`; those that are left open are no options.
    """
    words = [_COMMAND, "identify", shown(bag), "-o", shown(folder)]
    for name, value in request.items():
        if name == "known_modes_hz":
            words += [word for hz in value for word in ("--known-mode", f"{hz:g}")]
        elif value is not None:
            words += [f"--{name.replace('_', '-')}", f"{value}"]
    return shlex.join(words)


def tune_line(law: str, models: Sequence[str], margins: Mapping[str, float]) -> str:
    """Return the command line of a tuning, whose options have their margins without the unit."""
    words = [_COMMAND, "tune", "--law", LAWS[law].tuning, *models]
    for name, value in margins.items():
        words += [f"--{name.rpartition('_')[0].replace('_', '-')}", f"{value:g}"]
    return shlex.join(words)


def shown(path: Path) -> str:
    """Return a path as a person would type it: from the working folder, when it is below it."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)
