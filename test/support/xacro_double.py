"""Double of `xacro`, which the environment does not have: as much as our file uses."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_PREFIX = "{http://www.ros.org/wiki/xacro}"
Names = dict[str, object]


class _Expansion:
    """Macros and arguments of a file."""

    def __init__(self, arguments: dict[str, str]) -> None:
        self._arguments = arguments
        self._macros: dict[str, ET.Element] = {}

    def children(self, element: ET.Element, names: Names) -> Iterator[ET.Element]:
        """Yield what the children of an element become; properties are added to the names."""
        for child in element:
            tag = child.tag.removeprefix(_PREFIX)
            if tag == child.tag:
                made = ET.Element(
                    tag, {key: self._text(child.attrib[key], names) for key in child.attrib}
                )
                made.extend(self.children(child, names))
                yield made
            elif tag == "arg":
                self._arguments.setdefault(child.attrib["name"], child.attrib["default"])
            elif tag == "property":
                names[child.attrib["name"]] = _value(self._text(child.attrib["value"], names))
            elif tag == "macro":
                self._macros[child.attrib["name"]] = child
            else:
                yield from self._call(self._macros[tag], child, names)

    def _call(self, macro: ET.Element, call: ET.Element, names: Names) -> Iterator[ET.Element]:
        inner = dict(names)
        for parameter in macro.attrib["params"].split():
            name, _, default = parameter.partition(":=")
            inner[name] = _value(self._text(call.attrib.get(name, default), names))
        yield from self.children(macro, inner)

    def _text(self, text: str, names: Names) -> str:
        text = re.sub(r"\$\(arg (\w+)\)", lambda found: self._arguments[found[1]], text)
        return re.sub(
            r"\$\{(.+?)\}",
            lambda found: str(eval(found[1], {}, names)),  # noqa: S307 - our own file
            text,
        )


def _value(text: str) -> object:
    try:
        return float(text)
    except ValueError:
        return text


def expanded(file: Path, **arguments: str) -> ET.Element:
    """Return the robot that a file with macros describes."""
    root = ET.parse(file).getroot()  # noqa: S314 - our own file
    robot = ET.Element(root.tag, root.attrib)
    robot.extend(_Expansion(arguments).children(root, {}))
    return robot
