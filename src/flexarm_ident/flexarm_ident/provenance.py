"""Where a model came from: records with the hash of their content, method, request, versions.

There is no date in it: the same records and request give the same files, byte by byte.
"""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.iodata import IoData
    from flexarm_ident.workflow import Outcome

_PACKAGES = ("flexarm_ident", "numpy", "scipy", "control")


def model_provenance(outcome: Outcome, measured: Sequence[IoData]) -> dict[str, str | list[str]]:
    """Return what belongs beside an identified model.

    Parameters
    ----------
    outcome : Outcome
        The identification.
    measured : sequence of IoData
        The records as they were read, before any processing.

    Returns
    -------
    dict
        ``source`` and ``source_sha256`` (one entry per record), ``method``, ``request`` as JSON,
        and ``versions``.
    """
    return {
        "source": [record.label for record in measured],
        "source_sha256": [record_hash(record) for record in measured],
        "method": outcome.identification.method,
        "request": json.dumps(asdict(outcome.request)),
        "versions": ", ".join(
            [
                *(f"{name} {_version(name)}" for name in _PACKAGES),
                f"python {platform.python_version()}",
            ]
        ),
    }


def record_hash(record: IoData) -> str:
    """Return the SHA-256 of a record's period, channels and samples, as hexadecimal digits.

    Parameters
    ----------
    record : IoData
        The record. Its name does not count: a copied or converted bag has the same hash.

    Returns
    -------
    str
        The same for the same bits on every machine.
    """
    columns = (record.u, record.y, record.compensation, record.reference)
    facts = [
        record.dt_s.hex(),
        record.inputs,
        record.outputs,
        [None if column is None else column.shape for column in columns],
    ]
    digest = hashlib.sha256(json.dumps(facts).encode())
    for column in columns:
        if column is not None:
            digest.update(column.astype("<f8", copy=False).tobytes())
    return digest.hexdigest()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
