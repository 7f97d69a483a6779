"""Computations of the subjects: run in parallel, on this machine or on a Dask cluster, and kept.

Every result is kept as it comes, so that an interrupted run goes on where it stood.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import tempfile
import zlib
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import flexarm_control
import flexarm_core
import flexarm_daq
import flexarm_ident
from flexarm_core.own_files import is_own_file
from flexarm_core.workers import Workers
from flexarm_core.workers import computed as on_workers
from reproduction.framework.findings import ReproductionError, Subject

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from reproduction.framework.findings import Call, Finding, Results, Subject

    Progress = Callable[[str, float], None]

SOURCES = (
    Path(__file__).parents[1],
    *(
        Path(package.__file__ or "").parent
        for package in (flexarm_core, flexarm_daq, flexarm_ident, flexarm_control)
    ),
)
"""Folders of the source that results come from: the study, and the packages that it computes with.
"""
_LIBRARIES = ("numpy", "scipy", "numba", "control")
_COMPRESSION = 3


@dataclass(frozen=True)
class Outcome:
    """Outcome of one subject: its finding, or None and the failure in one line."""

    subject: Subject
    finding: Finding | None
    failure: str = ""


@cache
def source_digest() -> str:
    """Return a digest of all source and data that results come from, and of the libraries."""
    digest = hashlib.sha256(repr(platform.python_version_tuple()[:2]).encode())
    digest.update(repr([version(library) for library in _LIBRARIES]).encode())
    for folder in SOURCES:
        # Not by the whole path: the same package may lie elsewhere on another machine.
        for path in sorted(each for each in folder.rglob("*") if each.suffix in {".py", ".yaml"}):
            digest.update(repr((str(path.relative_to(folder)), path.read_bytes())).encode())
    return digest.hexdigest()


class Store:
    """A folder of results, one file per computation.

    A file holds the call, the digest of the source that computed it, and the result. A changed
    source replaces it.

    Parameters
    ----------
    folder : Path
        The folder; it is made when the first result comes.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def find(self, calls: Iterable[Call]) -> dict[Call, Any]:
        """Return the results that are there, of this user: a pickle runs what its writer says.

        A damaged file and an old source count as none.
        """
        found: dict[Call, Any] = {}
        for call in calls:
            path = self._path(call)
            if not (path.exists() and is_own_file(path)):
                continue
            try:
                # The whole file, so that one that was cut is told by its checksum.
                kept = pickle.loads(zlib.decompress(path.read_bytes()))  # noqa: S301 - our own
                if kept["call"] == call.name and kept["source"] == source_digest():
                    found[call] = kept["result"]
            except Exception:  # noqa: BLE001, S112 - a cut pickle can raise anything; it is computed anew
                continue
        return found

    def keep(self, call: Call, result: Any) -> None:  # noqa: ANN401 - whatever the call returns
        """Write a result; whoever reads meanwhile sees a whole one or none."""
        self._folder.mkdir(parents=True, exist_ok=True)
        content = {"call": call.name, "source": source_digest(), "result": result}
        handle, name = tempfile.mkstemp(dir=self._folder, suffix=".part")
        os.close(handle)
        try:
            Path(name).write_bytes(zlib.compress(pickle.dumps(content), _COMPRESSION))
            Path(name).replace(self._path(call))
        finally:
            Path(name).unlink(missing_ok=True)

    def _path(self, call: Call) -> Path:
        digest = hashlib.sha256(call.name.encode()).hexdigest()[:16]
        return self._folder / f"{call.function.__name__}-{digest}.pickle"


def reproduce(
    subjects: Sequence[Subject],
    store: Store,
    *,
    workers: Workers | None = None,
    progress: Progress | None = None,
    anew: bool = False,
) -> tuple[Outcome, ...]:
    """Compute the results that the store lacks, and build the findings.

    Parameters
    ----------
    subjects : sequence of Subject
        Subjects to reproduce.
    store : Store
        Store of the results.
    workers : Workers, optional
        Processes; by default the cores of this machine.
    progress : callable, optional
        Called with a word and the share that is done.
    anew : bool
        Compute what the store has too, and replace it.

    Returns
    -------
    tuple of Outcome
        One per subject. A computation that fails takes only those with it that need it.

    Raises
    ------
    WorkersError
        Without a cluster to compute on.
    """
    report = progress or (lambda _text, _part: None)
    calls = tuple(dict.fromkeys(call for subject in subjects for call in subject.needs))
    results = {} if anew else store.find(calls)
    missing = [call for call in calls if call not in results]
    failures: dict[Call, str] = {}
    report("computing", len(results) / max(len(calls), 1))
    for call, result, failure in computed(missing, workers or Workers()):
        if failure:
            failures[call] = failure
        else:
            store.keep(call, result)
            results[call] = result
        report("computing", (len(results) + len(failures)) / len(calls))
    outcomes = []
    for number, subject in enumerate(subjects, start=1):
        outcomes.append(_outcome(subject, results, failures))
        report("comparing", number / len(subjects))
    return tuple(outcomes)


def _outcome(subject: Subject, results: Results, failures: Mapping[Call, str]) -> Outcome:
    for call in subject.needs:
        if call in failures:
            return Outcome(subject, None, f"{call.name}: {failures[call]}")
    try:
        return Outcome(subject, subject.build({call: results[call] for call in subject.needs}))
    except Exception as error:  # noqa: BLE001 - one subject must not take the others with it
        return Outcome(subject, None, _failure(error))


def computed(calls: Sequence[Call], workers: Workers) -> Iterator[tuple[Call, Any, str]]:
    """Compute calls, in the order in which they end.

    Yields
    ------
    tuple of Call, object and str
        A call; its result, or None; the failure in one line, or an empty text.

    Raises
    ------
    WorkersError
        When the cluster cannot be reached or is lost, or `distributed` is not installed.
    """
    arguments = [(call, source_digest()) for call in calls]
    for number, result, failure in on_workers(_compute, arguments, workers):
        yield calls[number], result, failure


def _compute(call: Call, source: str) -> Any:  # noqa: ANN401 - whatever the call returns
    """Compute a call in a worker, which must have the caller's source."""
    if source_digest() != source:
        raise ReproductionError(f"{platform.node()} has another source of it; install the same")
    return call()


def _failure(error: BaseException) -> str:
    """Return the kind of an error and its message, in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".removesuffix(": ")
