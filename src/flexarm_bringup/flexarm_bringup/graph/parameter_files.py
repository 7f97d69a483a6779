"""Parameter files of nodes: who is meant in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping
    from pathlib import Path

_PARAMETERS = "ros__parameters"


def unknown_nodes(file: Path, known: Collection[str]) -> list[str]:
    """Return the nodes that a parameter file names and nobody has.

    Parameters
    ----------
    file
        As for `--params-file` of ROS 2. One that cannot be read is left to the nodes.
    known
        Full names of nodes.
    """
    try:
        content = yaml.safe_load(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return []
    names = _nodes(content, "") if isinstance(content, dict) else iter(())
    return [name for name in names if "*" not in name and name not in known]


def _nodes(content: Mapping[str, Any], namespace: str) -> Iterator[str]:
    for key, below in content.items():
        name = f"{namespace}/{str(key).strip('/')}"
        if isinstance(below, dict) and _PARAMETERS in below:
            yield name
        elif isinstance(below, dict):
            yield from _nodes(below, name)
