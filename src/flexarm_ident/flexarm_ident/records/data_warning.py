"""A defect of data, by its name and with figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class DataWarning:
    """One thing to know before trusting a model.

    Attributes
    ----------
    name : str
        What it is, the same for all data: ``saturation``.
    text : str
        One line that says where, how much, and what to do.
    figures : mapping of str to float
        The figures in the text.
    """

    name: str
    text: str
    figures: Mapping[str, float]

    def __str__(self) -> str:
        return self.text
