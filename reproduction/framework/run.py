"""Run what is asked for: the computations that are missing, in parallel, then the findings.

Every result is kept as it comes, so that an interrupted run goes on where it stood.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from reproduction.framework.computing import Workers, computed
from reproduction.framework.errors import one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from reproduction.framework.findings import Finding
    from reproduction.framework.store import Store
    from reproduction.framework.subjects import Call, Results, Subject

    Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Outcome:
    """What came of one subject.

    Attributes
    ----------
    subject
        The subject.
    finding
        The finding; None when it failed.
    failure
        Why it failed, in one line; empty when it did not.
    """

    subject: Subject
    finding: Finding | None
    failure: str = ""


def reproduce(
    subjects: Sequence[Subject],
    store: Store,
    *,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Compute what is missing in the store, and build the findings.

    Parameters
    ----------
    subjects
        What is wanted.
    store
        Where results are kept.
    workers
        Who computes; by default the cores of this machine.
    progress
        Called with a word and the part that is done.

    Returns
    -------
    tuple of Outcome
        One per subject. A computation that fails takes only those with it that need it.

    Raises
    ------
    ReproductionError
        When there is no cluster to compute on.
    """
    report = progress or (lambda _text, _part: None)
    calls = tuple(dict.fromkeys(call for subject in subjects for call in subject.needs))
    results = store.find(calls)
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
        return Outcome(subject, None, one_line(error))
