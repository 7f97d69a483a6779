"""Python files of the user's own, loaded as modules, and what is reported where they fail."""

from __future__ import annotations

import sys
import traceback
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from typing import TYPE_CHECKING

from flexarm_core.errors import FlexarmError, SettingError, one_line

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType


def own_module(path: Path, named: str) -> ModuleType:
    """Return the module of a file; its classes can be found again by their names.

    Parameters
    ----------
    path : Path
        The file.
    named : str
        What names it, for messages: a variable or another file.

    Raises
    ------
    SettingError
        If it cannot be read, is not a Python file, or raises.
    """
    if not path.is_file():
        raise SettingError(f"{named}: {path}: no such file")
    place = sha256(str(path.resolve()).encode()).hexdigest()[:8]
    name = f"flexarm_own_{path.stem}_{place}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise SettingError(f"{named}: {path}: no Python file: name it with the ending .py")
    module = sys.modules[name] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except FlexarmError:
        raise
    except (Exception, SystemExit) as error:
        raise SettingError(
            f"{named}: {path}{failed_line(error, path)}: {error_text(error)}"
        ) from error
    return module


def error_text(error: BaseException) -> str:
    """Return the kind and the text of an error in one line."""
    return f"{type(error).__name__}: {one_line(error)}"


def failed_line(error: BaseException, path: Path) -> str:
    """Return the line of a file in which an error came up, to be added to a text; or nothing."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [each.lineno for each in frames if each.filename == str(path)]
    return f", line {lines[-1]}" if lines else ""
