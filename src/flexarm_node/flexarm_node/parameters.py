"""Parameters declared from a table: type by the default, range, choices and description."""

from __future__ import annotations

import sys
from array import array
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.parameter import Parameter

from flexarm_core.errors import FlexarmError, SettingError, nearest
from flexarm_node.parameter_files import complaint, given_files

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.node import Node

    from flexarm_core.specs import ParameterSpec

    Values = dict[str, Any]


# Not of one node: what rclpy declares with a topic, and models, whose files are for every node.
_OPEN = ("qos_overrides.", "models.")
_SWITCH = ("off", "on")
_ANY_TYPE = ParameterDescriptor(dynamic_typing=True)


def descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    """Return the text, range and constraints that `ros2 param describe` shows of a parameter."""
    constraints = [f"unit: {spec.unit}"] if spec.unit else []
    if spec.choices:
        constraints.append(f"one of: {', '.join(spec.choices)}")
    if not spec.read_only:
        constraints.append(f"a change acts {spec.change_acts}")
    described = ParameterDescriptor(
        description=spec.description,
        additional_constraints="; ".join(constraints),
        read_only=spec.read_only,
    )
    if spec.minimum is not None and spec.maximum is not None:
        ends = {"from_value": spec.minimum, "to_value": spec.maximum}
        if isinstance(spec.default, int):
            whole = {name: int(end) for name, end in ends.items()}
            described.integer_range = [IntegerRange(**whole)]
        else:
            real = {name: float(end) for name, end in ends.items()}
            described.floating_point_range = [FloatingPointRange(**real)]
    return described


def _plain(value: Any) -> Any:  # noqa: ANN401 - of any parameter
    """Return a value as JSON and the tables have it; rclpy gives arrays of numbers."""
    return list(value) if isinstance(value, array) else value


class Parameters:
    """The declared parameters of a node, read and changed as one set.

    A parameter that is given at the start and that the node does not have is refused: it may be a
    misspelt safety limit.

    Parameters
    ----------
    node : Node
        The node that owns them.
    specs : sequence of ParameterSpec
        The table. Overrides from the command line or a parameter file are checked against it.
    open_group : str
        Beginning of the names of parameters that are taken without a table, such as ``models.``.
        Their values are given to `accept` and `apply` with the others. The node must allow
        undeclared parameters.
    accept : callable, optional
        Called with the complete set of values after a change, before it is made. A FlexarmError
        from it refuses the whole change with that line. It must not act on the values.
    apply : callable, optional
        Called with the complete set after a change was accepted, and not at the start.
    usual : callable, optional
        Called with the values that are given at the start; returns defaults that follow from them.

    Raises
    ------
    SettingError
        When the values given at the start are unknown, have the wrong type, are out of range or do
        not fit together.
    """

    def __init__(
        self,
        node: Node,
        specs: Sequence[ParameterSpec],
        *,
        open_group: str = "",
        accept: Callable[[Mapping[str, Any]], object] | None = None,
        apply: Callable[[Mapping[str, Any]], None] | None = None,
        usual: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None,
    ) -> None:
        self._node = node
        self._specs = {spec.name: spec for spec in specs}
        self._open_group = open_group
        self._accept = accept
        self._apply = apply
        self._restore_words()
        given = {name: each.value for name, each in self._overrides().items()}
        own = usual(given) if usual else {}
        for spec in specs:
            self._declare(replace(spec, default=own.get(spec.name, spec.default)))
        self._declare_open()
        self._refuse_unknown()
        name = node.get_fully_qualified_name()
        if misdirected := complaint(given_files(sys.argv), name):
            raise SettingError(misdirected)
        self._values = self._read()
        reason = self._refusal(self._values)
        if reason:
            raise SettingError(reason)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._on_changed)

    def values(self) -> Values:
        """Return all values by name; a change replaces them as a whole."""
        return self._values

    def _read(self) -> Values:
        names = [*self._specs, *self._open_names()]
        return {name: _plain(self._node.get_parameter(name).value) for name in names}

    def _open_names(self) -> list[str]:
        if not self._open_group:
            return []
        group = self._open_group.removesuffix(".")
        return [f"{group}.{name}" for name in self._node.get_parameters_by_prefix(group)]

    def _declare_open(self) -> None:
        for name, given in self._overrides().items():
            if self._is_open(name):
                self._node.declare_parameter(name, given.value, _ANY_TYPE)

    def _overrides(self) -> dict[str, Parameter]:
        given: dict[str, Parameter] = self._node._parameter_overrides  # noqa: SLF001 - rclpy gives it in no other way
        return given

    def _restore_words(self) -> None:
        """Give back the words "on" and "off", of which YAML has made true and false."""
        given = self._overrides()
        for name, spec in self._specs.items():
            value = given[name].value if name in given else None
            if isinstance(value, bool) and set(_SWITCH) <= set(spec.choices):
                given[name] = Parameter(name, value=_SWITCH[value])

    def _declare(self, spec: ParameterSpec) -> None:
        try:
            self._node.declare_parameter(spec.name, spec.default, descriptor(spec))
        except InvalidParameterTypeException:
            wanted = type(spec.default).__name__
            raise SettingError(
                f"parameter {spec.name} must be a {wanted}, such as {spec.default!r}"
            ) from None
        except InvalidParameterValueException:
            raise SettingError(
                f"parameter {spec.name} is out of its range, {spec.range_text}"
            ) from None

    def _refuse_unknown(self) -> None:
        unknown = [
            name
            for name in self._overrides()
            if not (self._node.has_parameter(name) or name.startswith(_OPEN))
        ]
        if unknown:
            raise SettingError(
                f"{self._node.get_fully_qualified_name()} has no parameter "
                f"{', '.join(map(self._with_nearest, unknown))}: correct the name or leave it out"
            )

    def _with_nearest(self, name: str) -> str:
        return name + nearest(name, self._specs)

    def _refusal(self, values: Mapping[str, Any]) -> str | None:
        for name, spec in self._specs.items():
            if complaint := spec.complaint(values[name]):
                return f"parameter {complaint}"
        if self._accept is not None:
            try:
                self._accept(values)
            except (FlexarmError, ValueError) as error:
                return str(error)
        return None

    def _on_set(self, changes: Sequence[Parameter]) -> SetParametersResult:
        if unknown := [change.name for change in changes if self._is_unknown(change.name)]:
            named = ", ".join(map(self._with_nearest, unknown))
            return SetParametersResult(successful=False, reason=f"no parameter {named}")
        ours = {each.name: _plain(each.value) for each in changes if self._is_ours(each.name)}
        reason = self._refusal(self._with(ours)) if ours else None
        return SetParametersResult(successful=reason is None, reason=reason or "")

    def _with(self, changes: Values) -> Values:
        """Return the values after a change; an open parameter without a value is deleted by it."""
        values = self._values | changes
        deleted = [name for name in values if name not in self._specs and values[name] is None]
        return {name: value for name, value in values.items() if name not in deleted}

    def _is_ours(self, name: str) -> bool:
        return name in self._specs or self._is_open(name)

    def _is_open(self, name: str) -> bool:
        return bool(self._open_group) and name.startswith(self._open_group)

    def _is_unknown(self, name: str) -> bool:
        # A node that allows undeclared parameters would take a misspelt name.
        allowed = self._is_ours(name) or self._node.has_parameter(name) or name.startswith(_OPEN)
        return bool(self._open_group) and not allowed

    def _on_changed(self, changes: Sequence[Parameter]) -> None:
        if not any(self._is_ours(change.name) for change in changes):
            return
        # Read once and kept: rclpy takes milliseconds for it, at the cost of a loop beside it.
        self._values = self._read()
        if self._apply is not None:
            self._apply(self._values)
