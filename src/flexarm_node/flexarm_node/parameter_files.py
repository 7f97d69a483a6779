"""Parameter files and command lines of ROS 2: whom they are for.

ROS 2 passes over a section for a node that does not exist without a word, and with it a misspelt
node's safety limits. A node that is given such a file and no section of its own does not start.

ROS 2 reads what stands between `--ros-args` and `--`, and drops everything else without a word: a
safety limit before `--ros-args` would be the default one.
"""

from __future__ import annotations

import itertools
import re
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_core.bounds import YamlError, read_text_bytes, shown, yaml_content
from flexarm_core.errors import FlexarmError, SettingError, reason
from flexarm_core.rig_description import SIMULATIONS, load_rig

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

LOOP = ("daq", "controller")
"""The nodes that answer each other, sample by sample."""
NODE_NAMES = (
    *LOOP,
    "experiment",
    "recorder",
    "ident",
    "tuner",
    "player",
    "live",
    "foxglove",
)
"""The nodes of flexarm, without their namespace."""
_PARAMETERS = "ros__parameters"
_FILE = "--params-file"
_PARAMETER = ("-p", "--param")
# Letters too many or too few.
_MISSPELT_BY = 2
BEGIN = "--ros-args"
"""ROS arguments stand after this word."""
_END = "--"
_RULE = "-r"
_ASSIGNS = ":="


def given_files(arguments: Sequence[str]) -> list[Path]:
    """Return the parameter files of a command line."""
    words = zip(itertools.pairwise([*arguments, ""]), are_for_ros(arguments), strict=True)
    return [Path(following) for (word, following), is_ros in words if is_ros and word == _FILE]


def wrong_words(arguments: Sequence[str]) -> str:
    """Return what is wrong with the parameters of a command line; empty for nothing.

    ROS 2 itself names neither the line of a file nor what a parameter lacks.
    """
    words = itertools.pairwise([*arguments, ""])
    given = [following for word, following in words if word in _PARAMETER]
    for each in given:
        name, sign, _ = each.partition(":=")
        if not (name and sign):
            return f"-p {each}: write NAME:=VALUE, such as rate_hz:=300.0"
    return next(filter(None, map(unreadable, given_files(arguments))), "")


def unreadable(file: Path) -> str:
    """Return why a file has no parameters of nodes; empty when it does, or is empty."""
    try:
        content = yaml_content(read_text_bytes(file).decode("utf-8"))
    except (OSError, UnicodeDecodeError, YamlError) as error:
        return f"{file}: {reason(error)}"
    except FlexarmError as error:
        return str(error)
    if content is None or (isinstance(content, dict) and list(_named(content, ""))):
        return ""
    return (
        f"{file}: has parameters of no node: write them below the node's name, "
        f"/**/daq: {{{_PARAMETERS}: {{rate_hz: 300.0}}}}"
    )


def sections(file: Path) -> list[tuple[str, Any]]:
    """Return names of nodes, or patterns of names, in a file, and what each section holds.

    A file that cannot be read has none.
    """
    try:
        content = yaml_content(read_text_bytes(file).decode("utf-8"))
    except (OSError, UnicodeDecodeError, FlexarmError):
        return []
    return list(_named(content, "")) if isinstance(content, dict) else []


def parameter(files: Sequence[Path], node: str, name: str) -> object:
    """Return a parameter of a node as the last of the files with it has it; None without one.

    Parameters
    ----------
    files : sequence of Path
        Parameter files, in the order in which the node reads them.
    node : str
        Full name of the node.
    name : str
        Name of the parameter.
    """
    values = [
        held[name]
        for file in files
        for section, held in sections(file)
        if is_for(section, node) and isinstance(held, dict) and name in held
    ]
    return values[-1] if values else None


def is_simulated(rig: str, files: Sequence[Path], node: str) -> bool:
    """Return whether a DAQ node samples a simulation; a rig that cannot be read is none.

    Parameters
    ----------
    rig : str
        Rig that the node is given; empty where the files, or its own default, say it.
    files : sequence of Path
        Parameter files of the node.
    node : str
        Its full name.
    """
    try:
        described = load_rig(rig or str(parameter(files, node, "rig") or "simulated"))
    except FlexarmError:
        return False
    return described.driver in SIMULATIONS


def is_for(section: str, node: str) -> bool:
    """Return whether a section is for a node; `*` is one part of a name, `**` any number."""
    pattern = re.escape(section).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
    return re.fullmatch(pattern, node) is not None


def unknown_nodes(file: Path, known: Collection[str]) -> list[str]:
    """Return the sections of a file that are for none of the known nodes."""
    return [name for name, _ in sections(file) if not any(is_for(name, node) for node in known)]


def complaint(files: Sequence[Path], node: str) -> str:
    """Return what is wrong with the sections of a node's files; empty when nothing is.

    Parameters
    ----------
    files : sequence of Path
        The files that the node was given.
    node : str
        Its full name.
    """
    own = node.rpartition("/")[2]
    for file in files:
        # A section for everybody names nobody.
        names = [name for name, _ in sections(file) if "*" not in _last(name)]
        if any(is_for(name, node) for name in names):
            continue
        for name in names:
            if _last(name) == own:
                return f"{file} has parameters for {name} and none for {node}: write /**/{own}"
            if _is_misspelt(_last(name), own):
                return f"{file} has parameters for {name}, no node here (nearest: {node})"
    return ""


def _is_misspelt(name: str, own: str) -> bool:
    """Return whether a name is meant for a node: not a renamed one's, nor a longer one with it."""
    return (
        name.rstrip("_0123456789") not in NODE_NAMES
        and abs(len(name) - len(own)) <= _MISSPELT_BY
        and bool(get_close_matches(name, [own], cutoff=0.65))
    )


def _last(name: str) -> str:
    return name.rpartition("/")[2]


def _named(content: Mapping[str, Any], namespace: str) -> Iterator[tuple[str, Any]]:
    for key, below in content.items():
        name = f"{namespace}/{str(key).strip('/')}"
        if isinstance(below, dict) and _PARAMETERS in below:
            yield name, below[_PARAMETERS]
        elif isinstance(below, dict):
            yield from _named(below, name)


def are_for_ros(words: Sequence[str]) -> list[bool]:
    """Mark the words of a command line that are for ROS 2, with those around them."""
    marks: list[bool] = []
    is_ros = False
    for word in words:
        was_ros, is_ros = is_ros, word == BEGIN or (is_ros and word != _END)
        marks.append(was_ros or is_ros)
    return marks


def own_words(words: Sequence[str]) -> list[str]:
    """Return those words of a command line, without the program's name, that are not for ROS 2."""
    return [word for word, is_ros in zip(words, are_for_ros(words), strict=True) if not is_ros]


def refuse_words(words: Sequence[str]) -> None:
    """Refuse words that nobody would read.

    Raises
    ------
    SettingError
        When there are any; it says what to write instead.
    """
    if not words:
        return
    if any(_ASSIGNS in word or word.startswith("-") for word in words):
        remedy = f"write {' '.join((BEGIN, *_as_ros(words)))}"
    else:
        remedy = "leave it out"
    raise SettingError(f"{shown(' '.join(words))} is not after {BEGIN}, and not read: {remedy}")


def _as_ros(words: Sequence[str]) -> Iterator[str]:
    """Yield words as ROS arguments: an assignment that stands alone is that of a parameter."""
    before = ""
    for word in words:
        if _ASSIGNS in word and not before.startswith("-"):
            is_rule = word.startswith("__") or "/" in word.partition(_ASSIGNS)[0]
            yield _RULE if is_rule else _PARAMETER[0]
        yield word
        before = word
