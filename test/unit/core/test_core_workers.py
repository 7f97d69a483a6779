"""Calls on this machine and on a Dask cluster."""

from __future__ import annotations

import operator
import os
import sys
from typing import Any

import distributed
import pytest

from flexarm_core import workers
from flexarm_core.workers import Workers, WorkersError, computed


def test_computed___here___gives_results_and_failures_by_their_numbers() -> None:
    found = sorted(computed(operator.truediv, [(1, 2), (1, 0), (6, 2)], Workers(jobs=1)))
    assert found == [(0, 0.5, ""), (1, None, "ZeroDivisionError: division by zero"), (2, 3.0, "")]
    assert list(computed(operator.neg, [], Workers(dask="nowhere"))) == []


def test_computed___two_jobs___in_other_processes() -> None:
    ((_, process, _),) = computed(os.getpid, [()], Workers(jobs=2))
    assert process != os.getpid()


def test_computed___cluster_without_workers___says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "CONNECT_S", 0.5)
    local_cluster: Any = distributed.LocalCluster
    with local_cluster(n_workers=0, dashboard_address=None, processes=False) as cluster:
        on = Workers(dask=cluster.scheduler_address)
        with pytest.raises(WorkersError, match="has no workers"):
            list(computed(operator.neg, [(1,)], on))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense"])
def test_computed___no_scheduler_there___says_so(
    monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setattr(workers, "CONNECT_S", 0.2)
    with pytest.raises(WorkersError, match=f"no Dask scheduler at {address}"):
        list(computed(operator.neg, [(1,)], Workers(dask=address)))


def test_computed___no_distributed___names_the_requirement(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(WorkersError, match=r"requirements/dask\.in"):
        list(computed(operator.neg, [(1,)], Workers(dask="tcp://127.0.0.1:1")))
