"""Parameter tables of nodes, one YAML file each, in the manner of *generate_parameter_library*.

The keys are those of that library: ``type``, ``default_value``, ``description``, ``read_only`` and
``validation`` with ``bounds<>``, ``one_of<>`` or ``subset_of<>``. A parameter may stand in a group,
and a group ``__map_names`` is there once for each member of ``names``. Two keys are our own:
``unit``, and ``live`` for a parameter whose change acts at once. A value ``$name`` is what the code
beneath has already, so that it is written once.
"""

from __future__ import annotations

from dataclasses import fields
from importlib.resources import files
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexarm_core.bounds import yaml_content
from flexarm_core.errors import SettingError
from flexarm_core.specs import ParameterSpec

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_TYPES = {"bool": bool, "int": int, "double": float, "string": str, "string_array": list}
_KEYS = {"type", "default_value", "description", "read_only", "validation", "unit", "live"}
_BOUNDS, _CHOICES = "bounds<>", {"one_of<>", "subset_of<>"}
_MAP = "__map_"
_NOTHING: Mapping[str, object] = MappingProxyType({})


def defaults(settings: Any) -> dict[str, object]:  # noqa: ANN401 - any dataclass
    """Return the values of a dataclass as a table names them, such as ``NidaqSettings.device``."""
    kind = type(settings).__name__
    return {f"{kind}.{field.name}": getattr(settings, field.name) for field in fields(settings)}


def read_table(
    package: str, node: str, known: Mapping[str, object] = _NOTHING
) -> tuple[ParameterSpec, ...]:
    """Read the table of a node, a file beside it.

    Parameters
    ----------
    package : str
        Python package that holds the file ``<node>.yaml``.
    node : str
        Name of the node, the one key at the top of the file.
    known : mapping of str to object
        What the code beneath has already, by the names that stand in the table behind a ``$``.

    Raises
    ------
    SettingError
        When the table has a key, a type or a name that is not known, or a default value of another
        type.
    """
    content: Any = yaml_content(files(package).joinpath(f"{node}.yaml").read_text("utf-8"))
    return tuple(_specs(content[node], "", known))


def _specs(
    rows: Mapping[str, Any], group: str, known: Mapping[str, object]
) -> Iterator[ParameterSpec]:
    for key, row in rows.items():
        if key.startswith(_MAP):
            for member in _found(key.removeprefix(_MAP), known):
                yield from _specs(row, f"{group}{member}.", known)
        elif "type" in row:
            yield _spec(group + key, _resolved(row, known))
        else:
            yield from _specs(row, f"{group}{key}.", known)


def _spec(name: str, row: Mapping[str, Any]) -> ParameterSpec:
    validation = row.get("validation", {})
    if strange := [*(row.keys() - _KEYS), *(validation.keys() - _CHOICES - {_BOUNDS})]:
        raise SettingError(f"table of parameters: {name} has {strange[0]}, which has no meaning")
    default = row["default_value"]
    if type(default) is not _TYPES.get(row["type"]):
        raise SettingError(
            f"table of parameters: {name} is a {row['type']}, and its default is {default!r}"
        )
    least, most = validation.get(_BOUNDS, (None, None))
    ((choices,),) = [validation[kind] for kind in _CHOICES & validation.keys()] or [((),)]
    return ParameterSpec(
        name,
        row["default_value"],
        row["description"],
        least,
        most,
        unit=row.get("unit", ""),
        choices=tuple(choices),
        read_only=row.get("read_only", False),
        live=row.get("live", False),
    )


def _resolved(value: Any, known: Mapping[str, object]) -> Any:  # noqa: ANN401 - of a YAML text
    """Return a value of a table with what the code knows in the places of its names."""
    if isinstance(value, dict):
        return {key: _resolved(each, known) for key, each in value.items()}
    if isinstance(value, list):
        return [_resolved(each, known) for each in value]
    if isinstance(value, str) and value.startswith("$"):
        return _found(value.removeprefix("$"), known)
    return value


def _found(name: str, known: Mapping[str, object]) -> Any:  # noqa: ANN401 - of any type
    if name not in known:
        raise SettingError(f"table of parameters: nothing is known as ${name}")
    value = known[name]
    return list(value) if isinstance(value, tuple) else value
