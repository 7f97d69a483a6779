"""One thread of BLAS while matrices are small.

Threads of BLAS wait for each other by spinning. On matrices of a few hundred rows they take longer
than one thread alone: four times on two quiet cores, ten times beside another program.
"""

from __future__ import annotations

from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit BLAS to one thread in this process, in a `with` statement or as a decorator.

    Of several Python threads, the first one inside sets the limit and ends it.
    """
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries() -> ThreadpoolController:
    """Return the numerical libraries of this process: NumPy and SciPy may each have their own."""
    import scipy.linalg  # noqa: F401, PLC0415 - for its BLAS; it takes long to import
    from threadpoolctl import ThreadpoolController  # noqa: PLC0415 - so does this

    return ThreadpoolController()
