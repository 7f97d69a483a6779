"""Compilation of numerical functions, with the result kept on disk where that is possible."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., object])

# Where numba finds scipy's BLAS, it loads it in every process, a third of a second, for np.kron
# alone; products of matrices load it when they are called.
_BLAS = "scipy.linalg.cython_blas"
if _BLAS not in sys.modules:
    sys.modules[_BLAS] = None  # type: ignore[assignment]  # the mark of a module that is not there
    import_module("numba.np.arraymath")
    del sys.modules[_BLAS]


def compiled(function: Function) -> Function:
    """Compile a function; keep the result on disk where the folder is writable.

    A division by zero gives what NumPy's gives. A check for it would keep the compiler from vector
    instructions.
    """
    try:
        return cast("Function", njit(cache=True, error_model="numpy")(function))
    except RuntimeError:
        return cast("Function", njit(error_model="numpy")(function))
