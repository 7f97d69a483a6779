"""Results of computations on disk, so that a run can be interrupted and nothing is computed twice.

One file per computation. It holds what was computed, the digest of the source that computed it, and
the result: a changed source replaces it.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import joblib

from reproduction.framework.source_digest import source_digest

if TYPE_CHECKING:
    from collections.abc import Iterable

    from reproduction.framework.subjects import Call

_COMPRESSION = 3


class Store:
    """A folder of results.

    Parameters
    ----------
    folder
        The folder; it is made when the first result comes.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def find(self, calls: Iterable[Call]) -> dict[Call, Any]:
        """Return the results that are there. A damaged file and an old source count as none."""
        found: dict[Call, Any] = {}
        for call in calls:
            path = self._path(call)
            if not path.is_file():
                continue
            try:
                kept = joblib.load(path)
                if kept["call"] == call.name and kept["source"] == source_digest(call.function):
                    found[call] = kept["result"]
            except Exception:  # noqa: BLE001, S112 - a cut pickle can raise anything; it is computed anew
                continue
        return found

    def keep(self, call: Call, result: Any) -> None:  # noqa: ANN401 - whatever the call returns
        """Write a result; whoever reads meanwhile sees a whole one or none."""
        self._folder.mkdir(parents=True, exist_ok=True)
        content = {"call": call.name, "source": source_digest(call.function), "result": result}
        handle, name = tempfile.mkstemp(dir=self._folder, suffix=".part")
        os.close(handle)
        try:
            joblib.dump(content, name, compress=_COMPRESSION)
            Path(name).replace(self._path(call))
        finally:
            Path(name).unlink(missing_ok=True)

    def _path(self, call: Call) -> Path:
        digest = hashlib.sha256(call.name.encode()).hexdigest()[:16]
        return self._folder / f"{call.function.__name__}-{digest}.joblib"
