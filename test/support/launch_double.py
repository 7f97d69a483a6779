"""Double of `launch` and `launch_ros`, which no package index has: as much as our file uses.

It follows launch_ros of Jazzy (`actions/node.py`, `utilities/namespace_utils.py`): parameters and
files reach a node as files in their order, and a relative namespace goes below the pushed one.
"""

from __future__ import annotations

import runpy
import sys
from dataclasses import dataclass, field
from types import ModuleType
from typing import TYPE_CHECKING, Any
from unittest import mock

import yaml

from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

FILE = PROJECT / "src/flexarm_bringup/launch/laboratory.launch.py"
Context = dict[str, str]


class LaunchConfiguration:
    """Value of an argument, or a default."""

    def __init__(self, name: str, default: str | None = None) -> None:
        self.name = name
        self.default = default

    def perform(self, context: Context) -> str:
        """Return the value in a context."""
        value = context.get(self.name, self.default)
        assert value is not None, self.name
        return value


@dataclass
class FindPackageShare:
    """Share folder of a package, here that of the sources."""

    package: str

    def perform(self, _: Context) -> str:
        """Return the folder."""
        return str(PROJECT / "src" / self.package)


@dataclass
class PathJoinSubstitution:
    """Path made of parts."""

    parts: list[Any]

    def perform(self, context: Context) -> str:
        """Return the path."""
        return "/".join(_text(part, context) for part in self.parts)


@dataclass
class ParameterValue:
    """Value of a parameter with its type."""

    value: LaunchConfiguration | str
    value_type: type


@dataclass
class DeclareLaunchArgument:
    """Argument of a launch file."""

    name: str
    default_value: Any
    description: str


@dataclass
class OpaqueFunction:
    """Function that makes actions when the launch has its arguments."""

    function: Callable[[Context], list[Node | LogInfo]]


@dataclass
class LogInfo:
    """Line for the user."""

    msg: str


@dataclass
class Node:
    """Node to start."""

    package: str
    executable: str
    name: str | None
    namespace: Any
    output: str
    remappings: list[tuple[str, str]] = field(default_factory=list)
    arguments: list[str] = field(default_factory=list)
    ros_arguments: list[str] = field(default_factory=list)
    parameters: list[Any] = field(default_factory=list)

    def command_line(self, context: Context, folder: Path) -> list[str]:
        """Return the arguments of the program; files for its parameters go into a folder."""
        space = _text(self.namespace, context)
        if not space.startswith("/"):
            space = f"{context.get('ros_namespace', '').rstrip('/')}/{space}"
        line = [*self.arguments, "--ros-args", *self.ros_arguments]
        line += ["-r", f"__node:={self.name}"] if self.name else []
        line += ["-r", f"__ns:={space}"]
        for pair in self.remappings:
            line += ["-r", ":=".join(pair)]
        for number, each in enumerate(self.parameters):
            file = _text(each, context)
            if isinstance(each, dict):
                file = str(folder / f"{self.name}_{number}.yaml")
                values = {name: _value(value, context) for name, value in each.items()}
                content = {f"{space}/{self.name}": {"ros__parameters": values}}
                (folder / f"{self.name}_{number}.yaml").write_text(yaml.dump(content))
            line += ["--params-file", file]
        return line


def _value(value: Any, context: Context) -> Any:  # noqa: ANN401 - of any type
    if isinstance(value, ParameterValue):
        return value.value_type(_text(value.value, context))
    return value


def _text(value: Any, context: Context) -> str:  # noqa: ANN401 - a text or a substitution
    return value.perform(context) if hasattr(value, "perform") else str(value)


def declared() -> dict[str, DeclareLaunchArgument]:
    """Return the arguments of the launch file by their names."""
    return {each.name: each for each in _actions() if isinstance(each, DeclareLaunchArgument)}


def launched(arguments: Mapping[str, str]) -> tuple[list[Node], Context]:
    """Return the nodes of the launch file with these arguments, and the context for them."""
    made, context = _made(arguments)
    return [each for each in made if isinstance(each, Node)], context


def reported(arguments: Mapping[str, str]) -> list[str]:
    """Return what the launch file tells the user with these arguments."""
    made, _ = _made(arguments)
    return [each.msg for each in made if isinstance(each, LogInfo)]


def _made(arguments: Mapping[str, str]) -> tuple[list[Node | LogInfo], Context]:
    context = dict(arguments)
    made: list[Node | LogInfo] = []
    for action in _actions():
        if isinstance(action, DeclareLaunchArgument):
            context.setdefault(action.name, _text(action.default_value, context))
        else:
            made += action.function(context)
    return made, context


def _actions() -> list[Any]:
    contents: dict[str, dict[str, Any]] = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {
            "DeclareLaunchArgument": DeclareLaunchArgument,
            "LogInfo": LogInfo,
            "OpaqueFunction": OpaqueFunction,
        },
        "launch.substitutions": {
            "LaunchConfiguration": LaunchConfiguration,
            "PathJoinSubstitution": PathJoinSubstitution,
        },
        "launch_ros": {},
        "launch_ros.actions": {"Node": Node},
        "launch_ros.parameter_descriptions": {"ParameterValue": ParameterValue},
        "launch_ros.substitutions": {"FindPackageShare": FindPackageShare},
    }
    modules = {name: ModuleType(name) for name in contents}
    for name, module in modules.items():
        vars(module).update(contents[name])
    with mock.patch.dict(sys.modules, modules):
        made: list[Any] = runpy.run_path(str(FILE))["generate_launch_description"]()
    return made
