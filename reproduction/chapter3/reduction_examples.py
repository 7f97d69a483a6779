"""The models that chapter 3 reduces: the record of each, its order and what is kept of it."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from flexarm_daq import RigParameters
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.beam import natural_frequencies_hz

if TYPE_CHECKING:
    from collections.abc import Mapping

BENDING_MODES = 3


@dataclass(frozen=True)
class Kept:
    """A reduced model: the ranking that chose its modes, and its number of states."""

    ranking: Literal["mrm", "msv", "mrmc"]
    order: int
    bending_modes: int = BENDING_MODES


@dataclass(frozen=True)
class Example:
    """One model of the thesis and what becomes of it.

    Attributes
    ----------
    code
        The thesis's name of the full model.
    experiment
        Record that it is identified from, on the first half.
    order
        Number of states of the full model.
    reduced
        The reduced models by the stage's name, as the thesis lists them: ``mrm``, ``msv`` and
        ``mrmc`` are not updated, all others are.
    compensation
        What happens to the Coulomb compensation in the input.
    unstable
        Whether the order is searched for a model with one slow unstable real eigenvalue.
    shown_seed
        The record that the figures show: the first one, or the first whose model of `order` is
        unstable.
    """

    code: str
    experiment: str
    order: int
    reduced: Mapping[str, Kept]
    compensation: Literal["remove", "keep"] = "remove"
    unstable: bool = False
    shown_seed: int = 1

    @property
    def known_modes_hz(self) -> tuple[float, ...]:
        """Bending modes of the arm with this payload, from the beam's equation."""
        arm = RigParameters(payload_kg=experiment(self.experiment).payload_kg)
        return tuple(natural_frequencies_hz(arm)[:BENDING_MODES].tolist())


def _three_ways(mrm: int, msv: int, mrmc: int, **updated: Kept) -> Mapping[str, Kept]:
    ways = {"mrm": Kept("mrm", mrm), "msv": Kept("msv", msv), "mrmc": Kept("mrmc", mrmc)}
    return MappingProxyType({**ways, **updated, "updated_msv": Kept("msv", msv)})


def _updated(ranking: Literal["mrm", "mrmc"], order: int) -> Mapping[str, Kept]:
    return MappingProxyType({"updated": Kept(ranking, order)})


TABLES: Mapping[str, str] = MappingProxyType(
    {"3-1": "Ac3_18", "3-2": "Ac11_26", "3-3": "Ac3_21u", "3-4": "Ao2_19", "3-5": "Ac11_18c"}
)
"""The examples with tables of their own."""

EXAMPLES: Mapping[str, Example] = MappingProxyType(
    {
        example.code: example
        for example in (
            Example(
                "Ac3_18",
                "C_dat3",
                18,
                _three_ways(
                    10, 11, 10, updated=Kept("mrmc", 10), further=Kept("mrmc", 8, bending_modes=2)
                ),
            ),
            Example(
                "Ac11_26",
                "C_dat11",
                26,
                _three_ways(
                    10,
                    11,
                    10,
                    updated=Kept("mrm", 10),
                    updated_mrmc=Kept("mrmc", 10),
                    further=Kept("mrmc", 8, bending_modes=2),
                ),
            ),
            Example(
                "Ac3_21u",
                "C_dat3",
                21,
                _three_ways(11, 11, 11, updated=Kept("mrmc", 11)),
                unstable=True,
                shown_seed=8,
            ),
            Example(
                "Ao2_19",
                "O_dat2",
                19,
                _three_ways(
                    11, 12, 11, updated=Kept("mrmc", 11), further=Kept("mrmc", 7, bending_modes=2)
                ),
            ),
            Example(
                "Ac11_18c",
                "C_dat11",
                18,
                _three_ways(
                    12, 12, 12, updated=Kept("mrmc", 12), further=Kept("mrmc", 8, bending_modes=2)
                ),
                compensation="keep",
            ),
            Example("Ao10_12", "O_dat10", 12, _updated("mrmc", 9)),
            Example("Ac5_22", "C_dat5", 22, _updated("mrmc", 10)),
            Example("Ac6_29", "C_dat6", 29, _updated("mrmc", 9)),
            Example("Ac14_32", "C_dat14", 32, _updated("mrmc", 10)),
            Example("Ac3_22c", "C_dat3", 22, _updated("mrm", 10), compensation="keep"),
        )
    }
)
"""All of them by the thesis's code: the five of Tables 3-1 to 3-5, and those of Table 3-6."""
