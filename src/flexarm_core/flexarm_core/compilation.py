"""Compilation of numerical functions, with the result kept on disk where that is possible."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar, cast

from numba import njit
from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile a function; keep the result on disk where the folder is writable.

    A division by zero gives what NumPy's gives. A check for it would keep the compiler from vector
    instructions.
    """
    try:
        kept = njit(cache=True, error_model="numpy")(function)
    except RuntimeError:
        return cast("Function", njit(error_model="numpy")(function))
    _drop_outdated(kept)
    return cast("Function", kept)


def _drop_outdated(kept: Dispatcher) -> None:
    """Remove what was kept before a file of a function that this one calls has changed.

    The compiler looks at the function's own file alone, and its code holds that of the others: it
    would go on with their former arrays, and write beyond the ends of those of today.
    """
    own = Path(kept.py_func.__code__.co_filename)
    files = {Path(each.py_func.__code__.co_filename) for each in _called(kept)} - {own}
    folder = kept.stats.cache_path
    if not files or folder is None:
        return
    changed_ns = max(file.stat().st_mtime_ns for file in files)
    for file in Path(folder).glob(f"{own.stem}.{kept.py_func.__qualname__}-*.nb[ic]"):
        # Another process may have the same intent.
        with suppress(FileNotFoundError):
            if file.stat().st_mtime_ns <= changed_ns:
                file.unlink()


def _called(function: Dispatcher) -> set[Dispatcher]:
    """Return a compiled function, those that it calls, and those that they call."""
    found: set[Dispatcher] = set()
    left = [function]
    while left:
        one = left.pop()
        if one not in found:
            found.add(one)
            known = [one.py_func.__globals__.get(name) for name in one.py_func.__code__.co_names]
            left += [each for each in known if isinstance(each, Dispatcher)]
    return found
