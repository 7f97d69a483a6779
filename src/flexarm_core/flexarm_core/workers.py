"""Workers: one function on many arguments, on every core of this machine or on a Dask cluster."""

from __future__ import annotations

import importlib
import logging
import signal
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import joblib

from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    Computed = tuple[int, Any, str]

CONNECT_S = 10.0
"""Deadline of a scheduler to answer, and to have a worker."""


class WorkersError(FlexarmError):
    """There is no cluster to compute on."""


@dataclass(frozen=True)
class Workers:
    """Processes that compute: `jobs` here, -1 for one per core, or those of a Dask cluster."""

    jobs: int = -1
    dask: str = ""


def computed(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], workers: Workers
) -> Iterator[Computed]:
    """Call a function with each of the arguments, in the order in which the calls end.

    Parameters
    ----------
    function : callable
        Function of a module that the workers can import.
    arguments : sequence of tuple
        Positional arguments of each call.
    workers : Workers
        Where the calls run.

    Yields
    ------
    tuple of int, object and str
        The number of a call; its result, or None; the failure in one line, or an empty text.

    Raises
    ------
    WorkersError
        When the cluster cannot be reached or is lost, or `distributed` is not installed.
    """
    if arguments:
        on = _on_cluster if workers.dask else _here
        yield from on(function, arguments, workers)


def _here(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], workers: Workers
) -> Iterator[Computed]:
    with joblib.parallel_config(
        "loky", n_jobs=workers.jobs, inner_max_num_threads=1, initializer=_leave_interrupts
    ):
        parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1)
        done = parallel(
            joblib.delayed(_guarded)(number, function, each)
            for number, each in enumerate(arguments)
        )
        try:
            yield from done
        finally:
            done.close()


def _on_cluster(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], workers: Workers
) -> Iterator[Computed]:
    # Not through joblib: its backend waits for ever when the scheduler refuses a task.
    with _cluster(workers.dask) as (client, distributed):
        # Each a task of its own, however often the same is asked for.
        waiting = {
            client.submit(_guarded, number, function, each, pure=False): number
            for number, each in enumerate(arguments)
        }
        for future in distributed.as_completed(waiting):
            number = waiting.pop(future)
            try:
                yield future.result()
            except distributed.KilledWorker as error:
                yield number, None, _failure(error)
            except (distributed.CancelledError, RuntimeError, ImportError) as error:
                raise WorkersError(
                    f"the cluster at {workers.dask} computes no more: {_failure(error)}; scheduler "
                    "and workers need flexarm as it is here in PYTHONPATH, what was computed is "
                    "kept"
                ) from error


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Any, Any]]:
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise WorkersError(
            "--dask needs distributed: pip install -r requirements/dask.in"
        ) from None
    # What it says at length is said in one line here.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = distributed.Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise WorkersError(
            f"no Dask scheduler at {address}: {_failure(error)}; start one with `dask scheduler`"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except distributed.TimeoutError:
            raise WorkersError(
                f"the Dask scheduler at {address} has no workers: start them with `dask worker`"
            ) from None
        yield client, distributed


def _leave_interrupts() -> None:
    """Leave Ctrl-C, which a terminal sends to all processes, to the one that ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _guarded(number: int, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Computed:
    """Call a function in a worker; the number identifies the call."""
    try:
        return number, function(*arguments), ""
    except Exception as error:  # noqa: BLE001 - the caller reports it
        return number, None, _failure(error)


def _failure(error: BaseException) -> str:
    """Return the kind of an error and its message, in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".removesuffix(": ")
