"""Check of an identification's data: a detector, and the kinds of warnings that it gives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING

from flexarm_ident.records.naming import short_names

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from flexarm_ident.records.data_warning import DataWarning, Kind
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram

    Detector = Callable[["Looked"], Iterable[DataWarning]]


@dataclass(frozen=True, eq=False)
class Looked:
    """What a detector looks at.

    Attributes
    ----------
    records : tuple of IoData
        Records of one rig.
    gram : BlockGram
        Their Gram, of as many block rows as the identification uses.
    feedthrough : bool
        Whether D is fitted.
    order : int
        Order of the model; 0 where there is none yet.
    """

    records: tuple[IoData, ...]
    gram: BlockGram
    feedthrough: bool = False
    order: int = 0

    @cached_property
    def names(self) -> dict[str, str]:
        """Short names of the records by their labels."""
        return short_names([record.label for record in self.records])

    @cached_property
    def wholes(self) -> list[tuple[str, list[IoData]]]:
        """Records with their short names, each in its parts."""
        parts = [
            list(each) for _, each in groupby(self.records, lambda one: one.part_of or id(one))
        ]
        labels = [each[0].part_of or each[0].label for each in parts]
        names = short_names(labels)
        return [(names[label], each) for label, each in zip(labels, parts, strict=True)]


@dataclass(frozen=True)
class Check:
    """Detector, and the kinds of data warnings that it gives."""

    detector: Detector
    kinds: tuple[Kind, ...]


def each_record(look: Callable[[IoData], Iterable[DataWarning]]) -> Detector:
    """Return the detector that looks at one record after the other."""

    def detector(data: Looked) -> Iterator[DataWarning]:
        for record in data.records:
            for found in look(record):
                yield replace(found, record=data.names[record.label])

    return detector


def each_whole(look: Callable[[Sequence[IoData]], Iterable[DataWarning]]) -> Detector:
    """Return the detector that looks at the parts of one record after the other."""

    def detector(data: Looked) -> Iterator[DataWarning]:
        for name, parts in data.wholes:
            for found in look(parts):
                yield replace(found, record=name)

    return detector
