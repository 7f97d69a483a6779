"""Compilation of numerical functions, with the result kept on disk where that is possible."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile a function; keep the result on disk where the folder is writable.

    A division by zero gives what NumPy's gives. A check for it would keep the compiler from vector
    instructions.
    """
    try:
        return cast("Function", njit(cache=True, error_model="numpy")(function))
    except RuntimeError:
        return cast("Function", njit(error_model="numpy")(function))
