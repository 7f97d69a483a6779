"""Kinds of mutants beside those of mutmut, which plants these too: defects that lived elsewhere.

Operands of a comparison are swapped, a text is compared by its begin or end, an attribute is not
set, a file is written in its place, and a value is not bounded on one side. Usage, in place of
`python -m mutmut`: `python -m bench.loop.mutation_kinds WORD...`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

# It comes with mutmut.
_cst: Any = import_module("libcst")
_ORDERS = (_cst.LessThan, _cst.LessThanEqual, _cst.GreaterThan, _cst.GreaterThanEqual)
_TEXTS = (_cst.SimpleString, _cst.FormattedString)
_OTHER_NAMES = {"with_name", "with_suffix", "with_stem"}
_BOUNDS = {"min", "max", "_clamp"}


def order(node: Any) -> Iterator[Any]:  # noqa: ANN401 - a node of libcst
    """Swap the operands of a comparison."""
    for target in node.comparisons:
        if len(node.comparisons) == 1 and isinstance(target.operator, _ORDERS):
            swapped = target.with_changes(comparator=node.left)
            yield node.with_changes(left=target.comparator, comparisons=[swapped])


def part_of_text(node: Any) -> Iterator[Any]:  # noqa: ANN401 - a node of libcst
    """Compare a text by its begin, and by its end."""
    target = node.comparisons[0]
    is_text = isinstance(node.left, _TEXTS) or isinstance(target.comparator, _TEXTS)
    if is_text and isinstance(target.operator, _cst.Equal):
        for method in ("startswith", "endswith"):
            compared = _cst.Attribute(node.left, _cst.Name(method))
            yield _cst.Call(compared, [_cst.Arg(target.comparator)])


def forgotten(node: Any) -> Iterator[Any]:  # noqa: ANN401 - a node of libcst
    """Do not set an attribute."""
    if any(isinstance(each.target, _cst.Attribute) for each in node.targets):
        yield _cst.Pass()


def in_place(node: Any) -> Iterator[Any]:  # noqa: ANN401 - a node of libcst
    """Write a file in its place, and not beside it first."""
    if isinstance(node.func, _cst.Attribute) and node.func.attr.value in _OTHER_NAMES:
        yield node.func.value


def unbounded(node: Any) -> Iterator[Any]:  # noqa: ANN401 - a node of libcst
    """Take one value in the place of a bounded one."""
    if isinstance(node.func, _cst.Name) and node.func.value in _BOUNDS:
        values = [each.value for each in node.args if each.keyword is None and not each.star]
        yield from values if len(values) > 1 else ()


KINDS = (
    (_cst.Comparison, order),
    (_cst.Comparison, part_of_text),
    (_cst.Assign, forgotten),
    (_cst.Call, in_place),
    (_cst.Call, unbounded),
)


def main() -> None:
    """Run mutmut with these kinds as well."""
    import_module("mutmut.mutation.mutators").mutation_operators.extend(KINDS)
    import_module("mutmut.__main__").cli()


if __name__ == "__main__":
    main()
