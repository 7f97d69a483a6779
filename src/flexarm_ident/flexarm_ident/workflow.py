"""The whole way from records to a validated, reduced model: what the service and the report do.

Preprocess every record (section 2.5), identify on its leading part, reduce and update (chapter 3),
validate on the whole of it (section 2.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.errors import IdentificationError
from flexarm_ident.iodata import as_records
from flexarm_ident.pipeline import identify
from flexarm_ident.preprocess import preprocess
from flexarm_ident.reduction import reduce_model
from flexarm_ident.validation import relative_errors, validate_dmv, validate_sfv

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.iodata import IoData
    from flexarm_ident.modes import Mode
    from flexarm_ident.pipeline import Identification
    from flexarm_ident.reduction import Reduction
    from flexarm_ident.validation import Dmv, Sfv

REDUCTIONS = ("none", "mrm", "msv", "mrmc")
UPDATES = ("none", "b", "c")
# The chosen reduced order may cost this much of the fit.
_REDUCTION_COST = 1.05
_SMALLEST_REDUCED_ORDER = 4


@dataclass(frozen=True)
class Request:
    """What is to be done with the records; the fields of the service `Identify`.

    Attributes
    ----------
    train_fraction : float
        Leading part of each record that is fitted, 0 < f <= 1.
    method : str
        Estimator, see `identify`.
    block_rows : int
        Block rows q of (2-18).
    order : int, optional
        Order of the full model; None: chosen.
    reduction : {'none', 'mrm', 'msv', 'mrmc'}
        Ranking by which modes are kept.
    reduced_order : int, optional
        States to keep; None: the fewest that cost at most 5 % of the fit.
    known_modes_hz : tuple of float
        Flexible modes that 'mrmc' keeps.
    update : {'none', 'b', 'c'}
        Matrix that is refitted after the reduction.
    remove_compensation : bool
        Subtract the recorded Coulomb compensation from the input.
    stabilise : bool
        Move unstable eigenvalues inside the unit circle.
    """

    train_fraction: float = 0.5
    method: str = "auto"
    block_rows: int = 40
    order: int | None = None
    reduction: str = "none"
    reduced_order: int | None = None
    known_modes_hz: tuple[float, ...] = ()
    update: str = "none"
    remove_compensation: bool = True
    stabilise: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.train_fraction <= 1.0:
            raise IdentificationError(
                f"train_fraction must lie between 0 and 1: {self.train_fraction}"
            )
        for field, choices in (("reduction", REDUCTIONS), ("update", UPDATES)):
            value = getattr(self, field)
            if value not in choices:
                raise IdentificationError(f"{field} must be one of {', '.join(choices)}: {value!r}")


@dataclass(frozen=True, eq=False)
class Outcome:
    """A validated model and everything that led to it.

    Attributes
    ----------
    request : Request
        What was asked for.
    records : tuple of IoData
        The preprocessed records, whole.
    trained : tuple of IoData
        Their leading parts, which were fitted.
    identification : Identification
        The full model.
    reduction : Reduction or None
        The reduced model, when one was asked for.
    full_dmv, dmv : tuple of Dmv
        Data matching of the full model and of `model`, one per record.
    dmv_errors : ndarray, (outputs,)
        Error delta (2-25) of `model` over all records together.
    sfv : Sfv or None
        Set-point following of `model` on the first record; None without a recorded reference.
    warnings : tuple of str
        What a user should know before trusting the model.
    """

    request: Request
    records: tuple[IoData, ...]
    trained: tuple[IoData, ...]
    identification: Identification
    reduction: Reduction | None
    full_dmv: tuple[Dmv, ...]
    dmv: tuple[Dmv, ...]
    dmv_errors: FloatArray
    sfv: Sfv | None
    warnings: tuple[str, ...]

    @property
    def model(self) -> control.StateSpace:
        """The reduced model if there is one, else the full one."""
        return self.reduction.model if self.reduction else self.identification.model

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Modes of the full model; those of the reduced one are marked as kept."""
        return self.reduction.modes if self.reduction else self.identification.modes


def run(
    records: IoData | Sequence[IoData],
    request: Request,
    *,
    progress: Callable[[str, float], None] | None = None,
) -> Outcome:
    """Identify, reduce, update and validate.

    Parameters
    ----------
    records : IoData or sequence of IoData
        Records of one rig as measured.
    request : Request
        What is to be done.
    progress : callable, optional
        Called with the name of the stage and the part of it that is done.

    Returns
    -------
    Outcome
        The model with its validation.

    Raises
    ------
    IdentificationError
        If the data or the request do not allow it.
    """
    report = progress or (lambda _stage, _fraction: None)
    compensation = "remove" if request.remove_compensation else "keep"
    prepared = tuple(
        preprocess(record, compensation=compensation)  # type: ignore[arg-type]
        for record in as_records(records)
    )
    trained = tuple(
        record.head(max(1, round(request.train_fraction * len(record)))) for record in prepared
    )
    identification = identify(
        trained,
        order=request.order,
        block_rows=request.block_rows,
        method=request.method,
        stable=request.stabilise,
        progress=progress,
    )
    report("reduction", 0.0)
    reduction = _reduce(identification, trained, request)
    report("validation", 0.0)
    model = reduction.model if reduction else identification.model
    full_dmv = tuple(validate_dmv(identification.model, record) for record in prepared)
    dmv = tuple(validate_dmv(model, record) for record in prepared) if reduction else full_dmv
    measured = np.vstack([record.y for record in prepared])
    sfv, notes = _set_point_following(model, prepared[0])
    report("validation", 1.0)
    return Outcome(
        request=request,
        records=prepared,
        trained=trained,
        identification=identification,
        reduction=reduction,
        full_dmv=full_dmv,
        dmv=dmv,
        dmv_errors=relative_errors(measured, np.vstack([each.y for each in dmv])),
        sfv=sfv,
        warnings=(
            *identification.warnings,
            *(reduction.warnings if reduction else ()),
            *notes,
        ),
    )


def _reduce(
    identification: Identification, records: Sequence[IoData], request: Request
) -> Reduction | None:
    if request.reduction == "none":
        return None

    def reduced(order: int) -> Reduction:
        return reduce_model(
            identification,
            records,
            ranking=request.reduction,  # type: ignore[arg-type]
            order=order,
            known_modes_hz=request.known_modes_hz,
            update=request.update,  # type: ignore[arg-type]
        )

    if request.reduced_order is not None:
        return reduced(request.reduced_order)
    affordable = _REDUCTION_COST * _fit_error(identification.model, records)
    smallest = min(
        identification.order, max(_SMALLEST_REDUCED_ORDER, 2 * len(request.known_modes_hz))
    )
    for order in range(smallest, identification.order):
        candidate = reduced(order)
        if _fit_error(candidate.model, records) <= affordable:
            return candidate
    return reduced(identification.order)


def _fit_error(model: control.StateSpace, records: Sequence[IoData]) -> float:
    return float(np.mean([validate_dmv(model, record).mean for record in records]))


def _set_point_following(model: control.StateSpace, record: IoData) -> tuple[Sfv | None, list[str]]:
    if record.reference is None:
        return None, []
    try:
        return validate_sfv(model, record), []
    except IdentificationError as error:
        return None, [f"no set-point following validation: {error}"]
