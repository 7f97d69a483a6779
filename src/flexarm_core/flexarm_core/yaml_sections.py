"""Sections of a YAML file, whose entries are taken one by one and refused with their line."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any, NoReturn

import yaml

from flexarm_core.bounds import YamlError, shown, yaml_content, yaml_node
from flexarm_core.errors import FlexarmError, nearest

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

_NAME = re.compile("[A-Za-z][A-Za-z0-9_]*")
_ANY = -math.inf, math.inf
_MERGE = "tag:yaml.org,2002:merge"


class SectionError(FlexarmError):
    """An entry of a file that cannot be used; the text begins with ``FILE:LINE``."""


class Section:
    """Mapping of a YAML file.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    node : yaml.Node
        Where it stands in the text.
    content : object
        What it says.
    place : str
        What leads to it, such as ``outputs.hub``; empty for the whole file.

    Raises
    ------
    SectionError
        From every method, with file and line, where an entry is not as it should be.
    """

    def __init__(self, file: str, node: yaml.Node, content: object, place: str = "") -> None:
        self._file, self._node, self._place = file, node, place
        if not isinstance(content, dict) or not isinstance(node, yaml.MappingNode):
            self.refuse(f"{place or 'the file'} must be a mapping, entries of NAME: VALUE")
        self._nodes: dict[object, tuple[yaml.Node, yaml.Node]] = {}
        for key, value in node.value:
            name = key.value
            if name in self._nodes:
                self.refuse(f"{self._full(name)} stands here twice: leave one", key)
            self._nodes[name] = key, value
        for key, value in _merged(node):
            self._nodes.setdefault(key.value, (key, value))
        self._content: Mapping[Any, Any] = content
        self._taken: set[str] = set()

    def __contains__(self, name: str) -> bool:
        # Who asks for an entry knows it, whether it is there or not.
        self._taken.add(name)
        return self._content.get(name) is not None

    @property
    def name(self) -> str:
        """Name of the section in the one around it."""
        return self._place.rpartition(".")[2]

    def line(self, at: yaml.Node | str | None = None) -> int:
        """Return the line of an entry, or that of the section itself, from 1."""
        entry = self._nodes.get(at, (None,))[0] if isinstance(at, str) else at
        return int((entry or self._node).start_mark.line) + 1

    def refuse(self, said: str, at: yaml.Node | str | None = None) -> NoReturn:
        """Raise a `SectionError` at an entry, or at the section itself."""
        raise SectionError(f"{self._file}:{self.line(at)}: {said}")

    def number(
        self,
        name: str,
        default: float | None = None,
        *,
        within: tuple[float, float] = _ANY,
        zero: bool = True,
    ) -> float:
        """Return a finite number, which may not be zero where that means nothing."""
        value = self._number(name, self._value(name, default))
        if not within[0] <= value <= within[1]:
            self.refuse(
                f"{self._full(name)} = {value:g} must lie from {within[0]:g} to {within[1]:g}", name
            )
        if not (value or zero):
            self.refuse(f"{self._full(name)} = 0 has no meaning: give another number", name)
        return value

    def whole(self, name: str, default: int, within: tuple[int, int]) -> int:
        """Return a whole number."""
        value = self.number(name, default, within=within)
        if value != int(value):
            self.refuse(f"{self._full(name)} = {value:g} must be a whole number", name)
        return int(value)

    def interval(
        self, name: str, default: tuple[float, float] | None = None
    ) -> tuple[float, float]:
        """Return the ends of a range: a list of two, or one number for both sides of zero."""
        value = self._value(name, default)
        ends = value if isinstance(value, (list, tuple)) else None
        if ends is None:
            size = self._number(name, value)
            if size <= 0.0:
                self.refuse(
                    f"{self._full(name)} = {size:g}: one number is the reach to both sides of "
                    "zero, and positive: or write [LOW, HIGH]",
                    name,
                )
            ends = -size, size
        if len(ends) != 2:  # noqa: PLR2004 - two ends
            self.refuse(f"{self._full(name)} must be a list of two, [LOW, HIGH]", name)
        low, high = (self._number(name, end) for end in ends)
        if not low < high:
            self.refuse(
                f"{self._full(name)} = [{low:g}, {high:g}]: the first end must be the lower one",
                name,
            )
        return low, high

    def flag(self, name: str) -> bool:
        """Return yes or no; no without the entry."""
        value = self._value(name, default=False)
        if not isinstance(value, bool):
            self.refuse(f"{self._full(name)} = {shown(value)} must be true or false", name)
        return value

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text that is not empty, but for the default."""
        value = self._value(name, default)
        value = value.strip() if isinstance(value, str) else value
        if not isinstance(value, str) or (name in self and not value):
            quoted = f': write "{value}"' if isinstance(value, int | float) else ""
            self.refuse(f"{self._full(name)} = {shown(value)} must be a text{quoted}", name)
        if not value.isprintable():
            self.refuse(
                f"{self._full(name)} = {shown(value)} must be one line of printable characters",
                name,
            )
        return value

    def word(
        self, name: str, known: Collection[str], default: str | None = None, *, role: str = ""
    ) -> str:
        """Return one of the words that are known, in a role where another one may have others."""
        return self.known(name, self.text(name, default), known, role)

    def words(
        self, name: str, known: Collection[str], default: Collection[str] | None = None
    ) -> tuple[str, ...]:
        """Return a list of known words, each once."""
        value = self._value(name, None if default is None else list(default))
        if not isinstance(value, list) or len(set(map(str, value))) != len(value):
            self.refuse(f"{self._full(name)} must be a list of names, each once", name)
        return tuple(self.known(name, each, known) for each in value)

    def known(self, name: str, value: object, known: Collection[str], role: str = "") -> str:
        """Return a word of the entry if it is known."""
        if value not in known:
            as_what = f" as {role}" if role else ""
            self.refuse(
                f"{self._full(name)} = {shown(value)} is not known{as_what}"
                f"{nearest(str(value), known)}",
                name,
            )
        return str(value)

    def section(self, name: str) -> Section:
        """Return the section of an entry, which may be missing."""
        if name not in self:
            empty = yaml.MappingNode("", [], self._node.start_mark)
            return Section(self._file, empty, {}, self._full(name))
        return Section(self._file, self._nodes[name][1], self._content[name], self._full(name))

    def sections(self, name: str) -> Iterator[Section]:
        """Yield the sections of an entry, of which each has the name of a channel or joint."""
        entries = self.section(name)
        for each in entries._nodes:  # noqa: SLF001 - of this class
            entries._require_name(each)  # noqa: SLF001
        for each in entries._content:  # noqa: SLF001
            yield entries.section(each)

    def listed(self, name: str) -> tuple[Section, ...]:
        """Return the sections of a list, one or more."""
        entries = self._value(name, None)
        if not isinstance(entries, list) or not entries:
            self.refuse(f"{self._full(name)} must be a list of mappings, at least one", name)
        return tuple(
            Section(self._file, node, each, f"{self._full(name)}[{number}]")
            for number, (node, each) in enumerate(
                zip(self._nodes[name][1].value, entries, strict=True)
            )
        )

    def _require_name(self, name: object) -> None:
        entry = str(name)
        if name in self._nodes and self._nodes[name][0].tag == _MERGE:
            return
        if not _NAME.fullmatch(entry):
            self.refuse(
                f"{self._full(entry)}: a name has letters, digits and _, a letter first", entry
            )
        if entry not in self._content:
            self.refuse(f"{self._full(entry)}: YAML takes {entry} for no text: rename it", entry)

    def values(self) -> dict[str, Any]:
        """Return all entries as they stand."""
        self._taken |= {str(name) for name in self._content}
        return {str(name): value for name, value in self._content.items()}

    def end(self) -> None:
        """Refuse the entries that were not taken."""
        for name in self._content:
            if name not in self._taken:
                self.refuse(
                    f"{self._full(str(name))} is not known{nearest(str(name), self._taken)}",
                    str(name),
                )

    def _value(self, name: str, default: object) -> Any:  # noqa: ANN401 - of a YAML text
        if name in self:
            return self._content[name]
        if default is None:
            others = [str(each) for each in self._content if each not in self._taken]
            self.refuse(f"{self._full(name)} is missing{nearest(name, others)}", name)
        return default

    def _number(self, name: str, value: object) -> float:
        # YAML takes 1e6 for a text.
        try:
            number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            self.refuse(f"{self._full(name)} = {shown(value)} must be a finite number", name)
        return number

    def _full(self, name: str) -> str:
        return f"{self._place}.{name}" if self._place else name


def _merged(node: yaml.MappingNode) -> Iterator[tuple[yaml.Node, yaml.Node]]:
    """Yield the entries that ``<<`` brings into a mapping; of equal names the first one counts."""
    for key, value in node.value:
        if key.tag == _MERGE:
            for each in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                yield from (entry for entry in each.value if entry[0].tag != _MERGE)
                yield from _merged(each)


def sections_of(
    text: str, file: str, *, remedy: str = "`flexarm rig new NAME` writes a template"
) -> Section:
    """Return the whole of a YAML text as a section; `remedy` is what to do about an empty one.

    Raises
    ------
    SectionError
        Where it is not YAML, or not a mapping.
    """
    try:
        content = yaml_content(text)
    except YamlError as error:
        place = file if error.line is None else f"{file}:{error.line}"
        raise SectionError(f"{place}: {error.said}") from None
    node = yaml_node(text)
    if node is None:
        raise SectionError(f"{file}:1: is empty: {remedy}")
    return Section(file, node, content)
