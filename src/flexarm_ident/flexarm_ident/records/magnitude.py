"""Magnitudes of channels: numbers whose powers would leave the range of double precision."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_core.arrays import column_range
from flexarm_core.errors import DataError
from flexarm_ident.records.data_warning import CONVERTED, Grade

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

# Fourth powers occur, and ratios of outputs to inputs.
_SMALLEST, _LARGEST = 1e-50, 1e50


def in_range(data: IoData) -> IoData:
    """Return a record with every channel in a range that can be computed with.

    A channel whose largest value is beyond 1e-50 to 1e50 is multiplied by a power of ten, and a
    notice says so. The compensation is multiplied as its input, the reference as the first output.
    """
    inputs, outputs = _exponents(data.u), _exponents(data.y)
    if not (inputs.any() or outputs.any()):
        return data
    names = (*data.inputs, *data.outputs)
    notices = [
        _notice(name, int(exponent))
        for name, exponent in zip(names, (*inputs, *outputs), strict=True)
        if exponent
    ]
    compensation, reference = data.compensation, data.reference
    return replace(
        data,
        u=_times(data.u, inputs),
        y=_times(data.y, outputs),
        compensation=None if compensation is None else _times(compensation, inputs),
        reference=None if reference is None else _times(reference, data.of_tracked(outputs)),
        notices=(*data.notices, *notices),
    )


def check_magnitude(data: IoData) -> None:
    """Refuse a record that `in_range` would change.

    Raises
    ------
    DataError
        When the largest value of a channel is beyond 1e-50 to 1e50.
    """
    for names, values in ((data.inputs, data.u), (data.outputs, data.y)):
        for channel in np.flatnonzero(_exponents(values)):
            raise DataError(
                f"{data.label}: {names[channel]} reaches {np.abs(values[:, channel]).max():.3g}, "
                "too far from 1 to compute with: prepare the record with preprocess, or give it in "
                "another unit"
            )


def _exponents(values: FloatArray) -> NDArray[np.intp]:
    """Return the powers of ten that bring each channel near 1; 0 where it need not."""
    low, high = column_range(values)
    largest = np.maximum(np.abs(low), np.abs(high))
    within = (largest == 0.0) | ((largest >= _SMALLEST) & (largest <= _LARGEST))
    return -np.floor(np.log10(np.where(within, 1.0, largest))).astype(np.intp)


def _times(values: FloatArray, exponents: Any) -> FloatArray:  # noqa: ANN401 - one or an array
    # In two steps: one power of ten may be beyond the range itself.
    half = exponents // 2
    return np.asarray(values * 10.0**half * 10.0 ** (exponents - half))


def _notice(name: str, exponent: int) -> DataWarning:
    return CONVERTED(
        f"{name} was multiplied by 1e{exponent:+d} to compute with it: the model has that unit",
        {"exponent": float(exponent)},
        grade=Grade.CAUTION,
        channel=name,
    )
