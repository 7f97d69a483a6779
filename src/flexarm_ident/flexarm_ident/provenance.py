"""Model provenance: records with the hash of their content, method, request, versions.

It has no date: the same records and request give the same files, byte by byte.
"""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core import __version__
from flexarm_ident.records.iodata import IoData
from flexarm_ident.records.naming import portable_names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.records.source import Source
    from flexarm_ident.workflow.outcome import Outcome

_CHUNK = 16_384
_PACKAGES = ("numpy", "scipy", "control")


def model_provenance(
    outcome: Outcome, measured: Sequence[Source]
) -> dict[str, str | list[str] | list[float]]:
    """Return the provenance fields of an identified model.

    Parameters
    ----------
    outcome : Outcome
        The identification.
    measured : sequence of Source
        The records before any processing.

    Returns
    -------
    dict
        ``source`` and ``source_sha256`` (one entry per record), ``method``, ``request`` as JSON,
        ``versions``, and the fields of `signal_fields`.
    """
    return {
        **signal_fields(measured),
        "source": portable_names([record.label for record in measured]),
        "source_sha256": [record_hash(record) for record in measured],
        "method": outcome.identification.method,
        "request": json.dumps(asdict(outcome.request)),
        "versions": ", ".join(
            [
                f"flexarm_ident {__version__}",
                *(f"{name} {version(name)}" for name in _PACKAGES),
                f"python {platform.python_version()}",
            ]
        ),
    }


def signal_fields(measured: Sequence[Source]) -> dict[str, str | list[str] | list[float]]:
    """Return what a twin of the model needs to know of the records, by the names of the fields.

    ``input_low``, ``input_high``, ``output_low`` and ``output_high`` are the ends of each signal,
    ``noise_sd`` is the standard deviation of each output's noise: the third differences of white
    noise have twenty times its power, those of motion at a usual rate next to none. ``record_s`` is
    the length of each record, s.
    """
    lows, highs, powers, rows = [], [], 0.0, 0
    for record in measured:
        for u, y in record.chunks(_CHUNK):
            signals = np.column_stack([u, y])
            lows.append(np.nanmin(signals, axis=0))
            highs.append(np.nanmax(signals, axis=0))
            changes = np.diff(y, n=3, axis=0)
            changes = changes[np.isfinite(changes).all(axis=1)]
            powers, rows = powers + np.sum(changes**2, axis=0), rows + len(changes)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    inputs = len(measured[0].inputs)
    noise = np.sqrt(powers / (20.0 * max(rows, 1)))
    return {
        "input_low": low[:inputs].tolist(),
        "input_high": high[:inputs].tolist(),
        "output_low": low[inputs:].tolist(),
        "output_high": high[inputs:].tolist(),
        "noise_sd": np.broadcast_to(noise, len(low) - inputs).tolist(),
        "record_s": [len(record) * record.dt_s for record in measured],
    }


def record_hash(record: Source) -> str:
    """Return the SHA-256 of a record's period, channels and samples, as hexadecimal digits.

    The name of the record does not count: a copied or converted bag has the same hash on every
    machine. A record that is read in chunks has neither compensation nor reference.
    """
    further = (record.compensation, record.reference) if isinstance(record, IoData) else (None,) * 2
    facts = [
        record.dt_s.hex(),
        record.inputs,
        record.outputs,
        [
            *((len(record), len(names)) for names in (record.inputs, record.outputs)),
            *(None if column is None else column.shape for column in further),
        ],
    ]
    digest = hashlib.sha256(json.dumps(facts).encode())
    _add_samples(digest, record)
    for column in further:
        if column is not None:
            digest.update(column.astype("<f8", copy=False).tobytes())
    return digest.hexdigest()


def samples_hash(record: Source) -> str:
    """Return the SHA-256 of a record's inputs and outputs alone, as hexadecimal digits."""
    digest = hashlib.sha256()
    _add_samples(digest, record)
    return digest.hexdigest()


def _add_samples(digest: hashlib._Hash, record: Source) -> None:
    for signal in (0, 1):
        for chunk in record.chunks(_CHUNK):
            digest.update(chunk[signal].astype("<f8", copy=False).tobytes())
