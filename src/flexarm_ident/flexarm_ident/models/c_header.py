"""Model as a C header, to the last bit."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from flexarm_core.outputs import MARK
from flexarm_ident.models.model_parameters import FIELDS, model_fields

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_ident.models.model_parameters import ParameterValue

_PER_LINE = 4


def c_header(name: str, parameters: Mapping[str, ParameterValue]) -> str:
    """Return a C99 and C++ header with a model as constants.

    It has macros for sizes and period, ``static const double`` row-major matrices, and the names of
    inputs and outputs, with provenance and hash in the comment. Numbers are the shortest decimals
    that a compiler turns into the same doubles (hexadecimal ones are not C++ before 2017).

    Parameters
    ----------
    name : str
        Name of the model.
    parameters : mapping
        The model as flat parameters.
    """
    fields: dict[str, Any] = model_fields(name, parameters)
    label = "model_" + re.sub(r"[^A-Za-z0-9_]", "_", name)
    macro = label.upper()
    sizes = {
        "STATES": fields["states"],
        "INPUTS": len(fields["input_names"]),
        "OUTPUTS": len(fields["output_names"]),
    }
    states, inputs, outputs = (f"{macro}_{size}" for size in sizes)
    shapes = {
        "a": (states, states),
        "b": (states, inputs),
        "c": (outputs, states),
        "d": (outputs, inputs),
    }
    origin = {key: value for key, value in fields.items() if key not in FIELDS}
    lines = [
        f"/* {MARK}",
        f" * Model {_remark(name)}: x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k].",
        " * Matrices are row-major, the period is in seconds.",
        *(f" * {key}: {_remark(value)}" for key, value in origin.items()),
        f" * hash: {fields['hash']}",
        " */",
        f"#ifndef {macro}_H",
        f"#define {macro}_H",
        "",
        *(f"#define {macro}_{size} {count}" for size, count in sizes.items()),
        f"#define {macro}_DT_S {fields['dt_s']!r}",
        "",
    ]
    for key, (height, width) in shapes.items():
        lines += [
            f"static const double {label}_{key}[{height} * {width}] = {{",
            *number_lines(fields[key]),
            "};",
        ]
    for key, size in (("input_names", inputs), ("output_names", outputs)):
        strings = ", ".join(c_string(text) for text in fields[key])
        lines.append(f"static const char *const {label}_{key}[{size}] = {{{strings}}};")
    return "\n".join([*lines, "", "#endif", ""])


def number_lines(numbers: Sequence[float]) -> list[str]:
    """Return lines of numbers for the braces of a C array, to the last bit."""
    texts = [repr(number) for number in numbers]
    starts = range(0, len(texts), _PER_LINE)
    return [f"    {', '.join(texts[start : start + _PER_LINE])}," for start in starts]


def c_string(text: str) -> str:
    """Return a C string; octal escapes also keep trigraphs out."""
    return '"' + "".join(_character(byte) for byte in text.encode()) + '"'


def _character(byte: int) -> str:
    plain = 0x20 <= byte < 0x7F and chr(byte) not in '"\\?'  # noqa: PLR2004 - printable ASCII
    return chr(byte) if plain else f"\\{byte:03o}"


def _remark(value: object) -> str:
    """Return one line of ASCII that does not end the comment around it."""
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    line = " ".join(text.encode("ascii", "backslashreplace").decode().split())
    return line.replace("*/", "* /").replace("/*", "/ *")
