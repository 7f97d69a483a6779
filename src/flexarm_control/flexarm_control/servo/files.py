"""File of a servo controller: a parameter file that Python, a node and the C export read alike."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.servo.controller import Servo, ServoGains
from flexarm_core.bounds import BoundError, read_text_bytes
from flexarm_core.errors import SettingError, reason
from flexarm_ident.models.model_parameters import (
    ModelFileError,
    parameters_in_text,
    write_parameter_file,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.models.model_parameters import ParameterValue

_ROOT = "servo."
_NAMES = ("inputs", "outputs", "tracked")
_FIGURES = ("rate_hz", "bandwidth_hz", "disk_margin")
# Names of the arrays, and what their sides are.
_ARRAYS = {
    "limits": ("inputs",),
    "A": ("states", "states"),
    "B": ("states", "inputs"),
    "C": ("outputs", "states"),
    "feedback": ("inputs", "states"),
    "correction": ("states", "outputs"),
    "deviation": ("states", "states"),
    "planning": ("inputs", "states"),
    "forward": ("terms", "inputs", "tracked"),
    "rest": ("states", "tracked"),
    "slopes": ("tracked",),
    "windows": ("means",),
    "levels": ("inputs",),
    "onsets": ("inputs", "tracked"),
}
# They may be infinite: without limits.
_UNBOUNDED = ("limits", "slopes")


def save_controller(
    path: Path | str, gains: ServoGains, provenance: Mapping[str, ParameterValue] | None = None
) -> None:
    """Write a controller as flat parameters ``servo.<field>``, matrices row-major.

    Parameters
    ----------
    path : Path or str
        File to write.
    gains : ServoGains
        The controller.
    provenance : mapping, optional
        Further parameters, such as the models of the design.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    values: dict[str, ParameterValue] = {name: list(getattr(gains, name)) for name in _NAMES}
    values |= {name: float(getattr(gains, name)) for name in _FIGURES}
    values |= {"states": len(gains.A), **(provenance or {})}
    values |= {
        name.lower(): np.asarray(getattr(gains, name), dtype=np.float64).ravel().tolist()
        for name in _ARRAYS
    }
    flat = {f"{_ROOT}{name}": value for name, value in values.items()}
    write_parameter_file(path, {"law": "servo", **flat}, node="/**/controller")


def load_controller(path: Path | str) -> Servo:
    """Read a controller that `flexarm design` wrote.

    Parameters
    ----------
    path : Path or str
        ``controller.yaml``.

    Returns
    -------
    Servo
        Controller, reset: ``u = controller.step(y, r)`` for each sample.

    Raises
    ------
    SettingError
        When the file cannot be read, or a field is missing or does not fit the others.
    """
    try:
        content = read_text_bytes(Path(path))
    except OSError as error:
        raise SettingError(f"{path}: {reason(error)}: name a controller.yaml") from error
    except BoundError as error:
        raise SettingError(f"{path}: {error}") from error
    return Servo(gains_in(content, path))


def gains_in(content: bytes, path: Path | str) -> ServoGains:
    """Return the gains in the content of a controller's file; `path` stands in the errors."""
    try:
        found = parameters_in_text(content)
    except (BoundError, ModelFileError) as error:
        raise SettingError(f"{path}: {error}") from error
    if not any(key.startswith(_ROOT) for key in found):
        raise SettingError(
            f"{path}: has no parameters {_ROOT}*: name a controller.yaml of the law servo"
        )
    inputs, outputs, tracked = (tuple(_names(path, found, key)) for key in _NAMES)
    missing = set(tracked) - set(outputs)
    if missing:
        raise SettingError(
            f"{path}: {_ROOT}tracked has {min(missing)}, which is none of its outputs: design again"
        )
    states = found.get(f"{_ROOT}states")
    sides = {"terms": 3, "means": 2, "states": states if isinstance(states, int) else 0}
    sides |= {"inputs": len(inputs), "outputs": len(outputs), "tracked": len(tracked)}
    rate_hz, bandwidth_hz, disk_margin = (float(_array(path, found, key, ())) for key in _FIGURES)
    arrays = {
        key: _array(path, found, key, tuple(sides[side] for side in shape))
        for key, shape in _ARRAYS.items()
    }
    if rate_hz <= 0.0 or (arrays["windows"] < 1.0).any():
        raise SettingError(f"{path}: {_ROOT}rate_hz and windows must be above zero: design again")
    windows = arrays.pop("windows").astype(np.int64)
    return ServoGains(
        inputs=inputs,
        outputs=outputs,
        tracked=tracked,
        rate_hz=rate_hz,
        bandwidth_hz=bandwidth_hz,
        disk_margin=disk_margin,
        windows=windows,
        **arrays,
    )


def _names(path: Path | str, found: Mapping[str, object], key: str) -> list[str]:
    value = found.get(_ROOT + key)
    if not isinstance(value, list) or not value or not all(isinstance(n, str) for n in value):
        raise SettingError(f"{path}: {_ROOT}{key} must be a list of names: design again")
    return value


def _array(
    path: Path | str, found: Mapping[str, object], key: str, shape: tuple[int, ...]
) -> FloatArray:
    name = _ROOT + key.lower()
    try:
        entries = np.array(found[name], dtype=np.float64).reshape(shape)
    except (KeyError, TypeError, ValueError):
        entries = np.array(np.nan)
    finite = ~np.isnan(entries) if key in _UNBOUNDED else np.isfinite(entries)
    if not finite.all():
        raise SettingError(
            f"{path}: {name} is missing or does not fit the other fields: design again"
        )
    return entries
