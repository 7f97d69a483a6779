"""Licences of everything that is installed in this environment, as each package states its own."""

from __future__ import annotations

import os
import re
import sys
from importlib.metadata import distributions
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from flexarm_core.labels import counted

if TYPE_CHECKING:
    from collections.abc import Iterable
    from importlib.metadata import PackageMetadata

_OURS = "flexarm"
_CLASSIFIER = "License :: "
# A longer text is the licence itself and not its name.
_LONGEST_NAME = 60
# The wheel `ros-jazzy-action-msgs` holds the package `action_msgs`.
_WHEEL = re.compile(r"^ros-((jazzy|kilted)-)?")
_LICENCE = re.compile(r"<license[^>]*>\s*([^<]*?)\s*</license>")
UNSTATED = "not stated"


class Licensed(NamedTuple):
    """A package, its version and its licence."""

    name: str
    version: str
    licence: str


def licence_name(metadata: PackageMetadata) -> str:
    """Return the licence in a package's metadata: the expression, else classifiers, else text."""
    # An email message: a field that is not there is None.
    expression = metadata.get_all("License-Expression", [])
    if expression:
        return str(expression[0])
    classifiers = [str(line) for line in metadata.get_all("Classifier", [])]
    named = [line.split(" :: ")[-1] for line in classifiers if line.startswith(_CLASSIFIER)]
    named = [name for name in named if name != "OSI Approved"]
    if named:
        return ", ".join(dict.fromkeys(named))
    texts = [str(text).strip() for text in metadata.get_all("License", [])]
    short = [text for text in texts if text and "\n" not in text and len(text) <= _LONGEST_NAME]
    if short and short[0] != "UNKNOWN":
        return short[0]
    return _in_package_xml(str(metadata["Name"])) or UNSTATED


def _in_package_xml(name: str) -> str:
    """Return the licences of a package of ROS, whose wheels state none; empty for another one."""
    package = _WHEEL.sub("", name).replace("-", "_")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", sys.prefix).split(os.pathsep):
        file = Path(prefix, "share", package, "package.xml")
        if file.is_file():
            return ", ".join(_LICENCE.findall(file.read_text("utf-8")))
    return ""


def licensed() -> list[Licensed]:
    """Return the installed packages that are not our own, by name."""
    found = {
        (str(each.metadata["Name"]), each.version): licence_name(each.metadata)
        for each in distributions()
        if each.metadata["Name"] and not str(each.metadata["Name"]).startswith(_OURS)
    }
    rows = (Licensed(*package, licence) for package, licence in found.items())
    return sorted(rows, key=lambda row: (row.name.lower(), row.version))


def licence_lines(rows: Iterable[Licensed]) -> list[str]:
    """Return packages, versions and licences in columns, one package a line."""
    every = list(rows)
    widths = [max(len(row[column]) for row in every) for column in range(2)]
    return [f"{row.name:<{widths[0]}}  {row.version:<{widths[1]}}  {row.licence}" for row in every]


def summary(rows: Iterable[Licensed]) -> str:
    """Return how many packages have no licence in their metadata."""
    unstated = [row.name for row in rows if row.licence == UNSTATED]
    if not unstated:
        return "every package states its licence"
    return f"{counted(len(unstated), 'package')} without a stated licence: {', '.join(unstated)}"
