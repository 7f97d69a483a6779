"""Parameters declared from a table: type by the default, range, choices and description."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException

from flexarm_core.errors import FlexarmError, SettingError
from flexarm_core.nearest import nearest
from flexarm_node.parameter_files import complaint, given_files

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.parameter import Parameter

    from flexarm_core.specs import ParameterSpec

    Values = dict[str, Any]


# Not of one node: what rclpy declares with a topic, and models, whose files are for every node.
_OPEN = ("qos_overrides.", "models.")


def descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    """Return the text and range that `ros2 param describe` shows of a parameter."""
    text = spec.description + (f" [{spec.unit}]" if spec.unit else "")
    described = ParameterDescriptor(description=text, read_only=spec.read_only)
    if spec.choices:
        described.additional_constraints = "one of: " + ", ".join(spec.choices)
    if spec.minimum is not None and spec.maximum is not None:
        ends = {"from_value": spec.minimum, "to_value": spec.maximum}
        if isinstance(spec.default, int):
            whole = {name: int(end) for name, end in ends.items()}
            described.integer_range = [IntegerRange(**whole)]
        else:
            real = {name: float(end) for name, end in ends.items()}
            described.floating_point_range = [FloatingPointRange(**real)]
    return described


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
    accept : callable, optional
        Called with the complete set of values after a change, before it is made. A FlexarmError
        from it refuses the whole change with that line. It must not act on the values.
    apply : callable, optional
        Called with the complete set after a change was accepted, and not at the start.

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
        accept: Callable[[Mapping[str, Any]], object] | None = None,
        apply: Callable[[Mapping[str, Any]], None] | None = None,
    ) -> None:
        self._node = node
        self._specs = {spec.name: spec for spec in specs}
        self._accept = accept
        self._apply = apply
        for spec in specs:
            self._declare(spec)
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
        return {name: self._node.get_parameter(name).value for name in self._specs}

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
        given = self._node._parameter_overrides  # noqa: SLF001 - rclpy tells it in no other way
        unknown = [
            name for name in given if not (self._node.has_parameter(name) or name.startswith(_OPEN))
        ]
        if unknown:
            raise SettingError(
                f"{self._node.get_fully_qualified_name()} has no parameter "
                f"{', '.join(f'{name}{nearest(name, self._specs)}' for name in unknown)}"
                ": correct the name or leave it out"
            )

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
        ours = {change.name: change.value for change in changes if change.name in self._specs}
        reason = self._refusal(self._values | ours) if ours else None
        return SetParametersResult(successful=reason is None, reason=reason or "")

    def _on_changed(self, changes: Sequence[Parameter]) -> None:
        if not any(change.name in self._specs for change in changes):
            return
        # Read once and kept: rclpy takes milliseconds for it, at the cost of a loop beside it.
        self._values = self._read()
        if self._apply is not None:
            self._apply(self._values)
