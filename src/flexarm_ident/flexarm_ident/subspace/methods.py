"""Registry of the subspace estimators: one row each.

A new estimator is a module with a function that returns a `Subspace`, and a row here. The check of
requests, `identify`, the command's help, the reports and the documentation read the rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from flexarm_core.errors import IdentificationError
from flexarm_ident.models.state_space import WAYS
from flexarm_ident.records.preprocess import output_scale
from flexarm_ident.subspace.orse import innovation_scaled, past_instruments, plain
from flexarm_ident.subspace.pbsid import predictor_space

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_ident.models.state_space import Way
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram
    from flexarm_ident.subspace.subspace_protocol import Subspace

AUTO = "auto"
"""Name of the choice from the data, see `choice` and `estimation.weighing`."""


class Data(NamedTuple):
    """Data for an estimator: products of `Method.shifts` block rows, and records or their heads.

    An `order` is one that alone is asked for.
    """

    gram: BlockGram
    records: Sequence[IoData]
    feedthrough: bool
    order: int | None = None


@dataclass(frozen=True)
class Method:
    """Estimator with its name, titles and needs.

    Attributes
    ----------
    name : str
        Value of `method` in requests.
    build : callable
        Function from `Data` to a `Subspace`.
    looks_back : bool
        Whether it takes as many block rows of the past as of the future.
    title : str
        Name in reports.
    help : str
        Field of use, in a few words.
    noise_weighted : bool
        Whether the fit of B weights the outputs by their noise.
    weighed : bool
        Whether 'auto' weighs it.
    ways : tuple of Way
        Ways to move unstable eigenvalues, the best of which is taken.
    consistent_under_feedback : bool
        Whether it is consistent where inputs were computed from the outputs.
    at_rest : bool
        Whether records start from rest and B is fitted without weights, as (2-14) and (2-17) are
        printed; otherwise initial states are fitted.
    """

    name: str
    build: Callable[[Data], Subspace]
    looks_back: bool
    title: str
    help: str
    noise_weighted: bool = True
    weighed: bool = True
    ways: tuple[Way, ...] = WAYS
    consistent_under_feedback: bool = False
    at_rest: bool = False

    def shifts(self, block_rows: int) -> int:
        """Return the block rows of the Gram for `block_rows` block rows of the future."""
        return 2 * block_rows if self.looks_back else block_rows


_ROWS = (
    Method(
        name="orse",
        build=lambda data: innovation_scaled(data.gram),
        looks_back=False,
        title="ORSE, outputs scaled by their innovation",
        help="open loop, white noise",
    ),
    Method(
        name="orse_iv",
        build=lambda data: past_instruments(data.gram),
        looks_back=True,
        title="ORSE with past data as instruments",
        help="coloured noise",
    ),
    Method(
        name="pbsid",
        build=lambda data: predictor_space(
            data.gram, feedthrough=data.feedthrough, order=data.order
        ),
        looks_back=True,
        title="PBSID-opt",
        help="closed loop, friction",
        consistent_under_feedback=True,
    ),
    Method(
        name="orse_thesis",
        build=lambda data: plain(data.gram, output_scale(data.records)),
        looks_back=False,
        title="ORSE, outputs scaled by their maxima",
        help="the thesis's own way, to reproduce it",
        noise_weighted=False,
        weighed=False,
        ways=("clamp",),
        at_rest=True,
    ),
)
METHODS = {row.name: row for row in _ROWS}
"""The estimators by name."""


def check_method(name: str) -> None:
    """Raise an IdentificationError for a method that is neither 'auto' nor in `METHODS`."""
    if name not in (AUTO, *METHODS):
        choices = ", ".join((AUTO, *METHODS))
        raise IdentificationError(f"method must be one of {choices}: {name!r}")
