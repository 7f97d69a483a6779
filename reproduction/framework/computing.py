"""Compute calls in parallel, on the cores of this machine or on a Dask cluster."""

from __future__ import annotations

import importlib
import logging
import platform
import signal
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import joblib

from reproduction.framework.errors import ReproductionError, one_line
from reproduction.framework.source_digest import source_digest

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from reproduction.framework.subjects import Call

CONNECT_S = 10.0
"""How long a scheduler may take to answer, and to have a worker."""


@dataclass(frozen=True)
class Workers:
    """Who computes.

    Attributes
    ----------
    jobs
        Processes on this machine; -1 is one per core. Each has one thread.
    dask
        Address of the scheduler of a Dask cluster that computes instead; empty for none.
    """

    jobs: int = -1
    dask: str = ""


def computed(calls: Sequence[Call], workers: Workers) -> Iterator[tuple[Call, Any, str]]:
    """Compute calls, in the order in which they end.

    Parameters
    ----------
    calls
        What to compute.
    workers
        Who does it.

    Yields
    ------
    Call
        One of them.
    object
        Its result; None when it failed.
    str
        Why it failed, in one line; empty when it did not.

    Raises
    ------
    ReproductionError
        When the cluster cannot be reached or is lost, or `distributed` is not installed.
    """
    if calls:
        yield from _on_cluster(calls, workers.dask) if workers.dask else _here(calls, workers.jobs)


def _here(calls: Sequence[Call], jobs: int) -> Iterator[tuple[Call, Any, str]]:
    with joblib.parallel_config(
        "loky", n_jobs=jobs, inner_max_num_threads=1, initializer=_leave_interrupts
    ):
        parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1)
        done = parallel(
            joblib.delayed(_compute)(number, call, source_digest(call.function))
            for number, call in enumerate(calls)
        )
        try:
            for number, result, failure in done:
                yield calls[number], result, failure
        finally:
            done.close()


def _on_cluster(calls: Sequence[Call], address: str) -> Iterator[tuple[Call, Any, str]]:
    # Not through joblib: its backend waits for ever when the scheduler refuses a task.
    with _cluster(address) as (client, distributed):
        # Each a task of its own, however often the same is asked for.
        waiting = {
            client.submit(_compute, number, call, source_digest(call.function), pure=False): call
            for number, call in enumerate(calls)
        }
        for future in distributed.as_completed(waiting):
            call = waiting.pop(future)
            try:
                _, result, failure = future.result()
            except distributed.KilledWorker as error:
                result, failure = None, one_line(error)
            except (distributed.CancelledError, RuntimeError, ImportError) as error:
                raise ReproductionError(
                    f"the cluster at {address} computes no more: {one_line(error)}; scheduler and "
                    "workers need flexarm as it is here, what was computed is kept"
                ) from error
            yield call, result, failure


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Any, Any]]:
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise ReproductionError(
            "--dask needs distributed: pip install -r requirements/dask.in"
        ) from None
    # What it says at length is said in one line here.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = distributed.Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise ReproductionError(
            f"no Dask scheduler at {address}: {one_line(error)}; start one with `dask scheduler`"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except distributed.TimeoutError:
            raise ReproductionError(
                f"the Dask scheduler at {address} has no workers: start them with `dask worker`"
            ) from None
        yield client, distributed


def _leave_interrupts() -> None:
    """Leave Ctrl-C, which a terminal sends to all processes, to the one that ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _compute(number: int, call: Call, source: str) -> tuple[int, Any, str]:
    """Compute a call in a worker; its number tells the caller which one it was."""
    try:
        if source_digest(call.function) != source:
            return number, None, f"{platform.node()} has another source of it; install the same"
        return number, call(), ""
    except Exception as error:  # noqa: BLE001 - the caller reports it
        return number, None, one_line(error)
