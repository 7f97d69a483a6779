"""Parameters declared from a table: type by the default, range, choices and description."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException

from flexarm_core.errors import FlexarmError, SettingError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.parameter import Parameter

    from flexarm_core.specs import ParameterSpec

    Values = dict[str, Any]


# Declared by rclpy when a topic that has them is made, which may be later.
_MIDDLEWARE = "qos_overrides."


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

    A parameter that is given at the start and that the node does not have is named in a warning.

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
    later : tuple of str
        Beginnings of names that the node may declare later on.

    Raises
    ------
    SettingError
        When the values given at the start have the wrong type, are out of range or do not fit
        together.
    """

    def __init__(
        self,
        node: Node,
        specs: Sequence[ParameterSpec],
        *,
        accept: Callable[[Mapping[str, Any]], object] | None = None,
        apply: Callable[[Mapping[str, Any]], None] | None = None,
        later: tuple[str, ...] = (),
    ) -> None:
        self._node = node
        self._specs = {spec.name: spec for spec in specs}
        self._accept = accept
        self._apply = apply
        for spec in specs:
            self._declare(spec)
        self._values = self._read()
        reason = self._refusal(self._values)
        if reason:
            raise SettingError(reason)
        self._warn_of_unknown((*later, _MIDDLEWARE))
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

    def _warn_of_unknown(self, later: tuple[str, ...]) -> None:
        given = self._node._parameter_overrides  # noqa: SLF001 - rclpy tells it in no other way
        for name in given:
            if self._node.has_parameter(name) or name.startswith(later):
                continue
            near = get_close_matches(name, self._specs, n=1)
            self._node.get_logger().warning(
                f"parameter {name} is unknown and has no effect"
                + (f"; did you mean {near[0]}?" if near else "")
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
