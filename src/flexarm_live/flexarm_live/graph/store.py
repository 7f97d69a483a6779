"""Folder of a laboratory's records and models, each known by its name and by nothing else."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

from flexarm_bags.metadata import FILE_NAME
from flexarm_core.errors import FlexarmError
from flexarm_core.nearest import nearest
from flexarm_ident.job import MODEL_FILE, REPORT_FILE

if TYPE_CHECKING:
    from pathlib import Path

_MODELS = "models"


class Store:
    """Records in a folder, and the models that were identified from them below it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def new_bag(self, kind: str) -> Path:
        """Return where a new record goes: its kind and the time of now."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return self.folder / f"{kind}_{datetime.now().astimezone():%Y%m%d_%H%M%S}"

    def bags(self) -> list[str]:
        """Return the names of the records, newest first."""
        found = self.folder.glob(f"*/{FILE_NAME}") if self.folder.is_dir() else ()
        by_age = sorted(found, key=lambda file: file.stat().st_mtime, reverse=True)
        return [file.parent.name for file in by_age]

    def bag(self, name: str) -> Path:
        """Return the folder of a record; a `FlexarmError` for a name that is none."""
        return self.folder / _known("record", name, self.bags())

    def models(self) -> list[str]:
        """Return the names of the identified models."""
        found = (self.folder / _MODELS).glob(f"*/{MODEL_FILE}")
        return sorted(file.parent.name for file in found)

    def model_folder(self, name: str) -> Path:
        """Return the folder of the model of a record, which may not be there yet."""
        return self.folder / _MODELS / name

    def model_file(self, name: str) -> Path:
        """Return the file of a model; a `FlexarmError` for a name that is none."""
        return self.model_folder(_known("model", name, self.models())) / MODEL_FILE

    def report(self, name: str) -> bytes | None:
        """Return the report of a model; None for a name that is none."""
        if name not in self.models():
            return None
        file = self.model_folder(name) / REPORT_FILE
        return file.read_bytes() if file.is_file() else None


def _known(kind: str, name: str, names: list[str]) -> str:
    if name not in names:
        raise FlexarmError(f"no {kind} {name!r}{nearest(name, names)}")
    return name
