"""Request of an identification."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flexarm_core.errors import IdentificationError
from flexarm_ident.records.preprocess import BIASES

REDUCTIONS = ("none", "mrm", "msv", "mrmc")
UPDATES = ("none", "b", "c")
FEEDTHROUGH = {"auto": None, "yes": True, "no": False}
"""Values of `identify` by names; None leaves it to the data."""
THESIS_FILTER = {"cutoff_hz": 50.0, "filter_input": False}
"""Low-pass filter of section 2.5."""


@dataclass(frozen=True)
class Request:
    """Options of an identification; the fields of the service `Identify`.

    Attributes
    ----------
    train_fraction : float
        Leading part of each record that is fitted, 0 < f <= 1. Less than all shows how the model
        does on the rest; `Outcome.cross_validation` shows it without giving up data.
    method : str
        Estimator, see `identify`.
    block_rows : int, optional
        Block rows q of (2-18); None: 40, fewer where the records are too short for as many.
    order : int, optional
        Order of the full model; None: chosen.
    singular_value_threshold : float, optional
        Threshold of (2-22) in units of the largest singular value: the order is the number of
        singular values above it. None: the order is chosen in another way.
    feedthrough : {'auto', 'yes', 'no'}
        Whether D is fitted; 'auto' fits it where the data were made in open loop and ask for it.
    bias : {'', 'rest', 'first', 'mean', 'none'}
        Level that is subtracted from each output, see `preprocess`. '': the rest; the first sample
        with 'orse_thesis', as section 2.5 has it.
    cutoff_hz : float, optional
        Cut-off of a low-pass filter, 0 for none. None: none; 50 Hz on the outputs alone with
        'orse_thesis', as section 2.5 has it.
    filter_input : bool
        Whether the input is filtered too.
    reduction : {'none', 'mrm', 'msv', 'mrmc'}
        Ranking that selects the kept modes.
    reduced_order : int, optional
        States to keep; None: the fewest that cost at most 4 % of the fit. More than a chosen order
        gives the whole model and a note.
    known_modes_hz : tuple of float
        Flexible modes that 'mrmc' keeps; with it alone.
    update : {'none', 'b', 'c'}
        Matrix that is refitted after the reduction.
    remove_compensation : bool
        Subtract the recorded Coulomb compensation from the input.
    stabilise : bool
        Move unstable eigenvalues inside the unit circle.
    friction : bool
        Search for dry friction where no compensation was recorded, and model it where `identify`
        finds it significant.
    refine : bool
        Refine the model by its likelihood, or by its simulation error where its errors are
        not noise; the measure never gets worse.
    """

    train_fraction: float = 1.0
    method: str = "auto"
    block_rows: int | None = None
    order: int | None = None
    singular_value_threshold: float | None = None
    feedthrough: str = "auto"
    bias: str = ""
    cutoff_hz: float | None = None
    filter_input: bool = True
    reduction: str = "none"
    reduced_order: int | None = None
    known_modes_hz: tuple[float, ...] = ()
    update: str = "none"
    remove_compensation: bool = True
    stabilise: bool = True
    friction: bool = True
    refine: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.train_fraction <= 1.0:
            raise IdentificationError(
                f"train_fraction must lie between 0 and 1: {self.train_fraction}"
            )
        self._prepare_as_the_method()
        for field, choices in (
            ("reduction", REDUCTIONS),
            ("update", UPDATES),
            ("feedthrough", FEEDTHROUGH),
            ("bias", BIASES),
        ):
            value = getattr(self, field)
            if value not in choices:
                raise IdentificationError(f"{field} must be one of {', '.join(choices)}: {value!r}")
        self._check_threshold()
        self._check_reduction()

    def _prepare_as_the_method(self) -> None:
        """Set what is unset as the method has it: the thesis prepares its records in its way."""
        is_thesis = self.method == "orse_thesis"
        prepared: dict[str, object] = {"bias": self.bias or ("first" if is_thesis else "rest")}
        if is_thesis and self.cutoff_hz is None:
            prepared |= THESIS_FILTER
        for field, value in prepared.items():
            object.__setattr__(self, field, value)

    def _check_threshold(self) -> None:
        threshold = self.singular_value_threshold
        if threshold is None:
            return
        if not 0.0 < threshold < 1.0:
            raise IdentificationError(
                "singular_value_threshold is a part of the largest singular value, between 0 and "
                f"1: {threshold:g}"
            )
        if self.order is not None:
            raise IdentificationError(
                f"order = {self.order} and singular_value_threshold = {threshold:g} both set the "
                "order: give one of them"
            )

    def _check_reduction(self) -> None:
        """Refuse options that would be ignored, before the fit takes its time."""
        if self.reduction == "none":
            for field, value in (("reduced_order", self.reduced_order), ("update", self.update)):
                if value not in (None, "none"):
                    raise IdentificationError(
                        f"{field} = {value} needs a reduction: choose one of "
                        f"{', '.join(choice for choice in REDUCTIONS if choice != 'none')}"
                    )
        for hz in self.known_modes_hz:
            if not 0.0 < hz < math.inf:
                raise IdentificationError(
                    f"a known mode of {hz:g} Hz: give the frequency as a positive number "
                    "(known_modes_hz, --known-mode)"
                )
        if self.reduced_order is not None:
            self._check_reduced_order(self.reduced_order)
        if (self.reduction == "mrmc") != bool(self.known_modes_hz):
            raise IdentificationError(
                "reduction mrmc and known modes belong together: give both, with the frequencies "
                "in Hz of the flexible modes to keep, or neither (--reduction mrmc, --known-mode; "
                "known_modes_hz)"
            )

    def _check_reduced_order(self, reduced_order: int) -> None:
        smallest = max(1, 2 * len(self.known_modes_hz))
        if reduced_order < smallest:
            raise IdentificationError(
                f"reduced_order = {reduced_order} is too small: {smallest} or more, two states "
                "for each known mode"
            )
        if self.order is not None and reduced_order > self.order:
            raise IdentificationError(
                f"reduced_order = {reduced_order} is more than order = {self.order}: lower it, "
                "or raise the order or leave it open"
            )
