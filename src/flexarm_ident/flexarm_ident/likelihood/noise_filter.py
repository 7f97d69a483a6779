"""Autoregressive noise of outputs: its inverse filter, and whether it is noise at all.

The errors of a good model are coloured noise. A filter with the coefficients of an autoregressive
model whitens them, and what is left is uncorrelated with the inputs before it. Errors of a model
that misses dynamics or friction recur with the input.

Durbin, "The fitting of time-series models", Review of the International Statistical Institute 28
(1960), for the recursion; Ljung, "System Identification", 2nd ed., Prentice Hall (1999), section
16.6, for the test.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray

_LONGEST = 30
_LAGS = 150
# One false alarm in a thousand records.
_SIGNIFICANCE = 1e-3


def whitening_filter(errors: Sequence[FloatArray]) -> FloatArray:
    """Return the filter that turns the errors of one output into white noise of unit variance.

    Of the autoregressive models up to order 30 the one with the smallest BIC is taken.

    Parameters
    ----------
    errors : sequence of ndarray, (samples,)
        Errors of each record; NaN where there is none.

    Returns
    -------
    ndarray, (order + 1,)
        Coefficients, that of the present sample first; zero for errors that are zero throughout.
    """
    known = [np.nan_to_num(e) for e in errors]
    samples = sum(int(np.count_nonzero(~np.isnan(e))) for e in errors)
    longest = min(_LONGEST, *(len(e) - 1 for e in known))
    products = [
        sum(float(e[lag:] @ e[: len(e) - lag]) for e in known) for lag in range(longest + 1)
    ]
    covariance = np.array(products) / max(samples, 1)
    if covariance[0] <= 0.0:
        return np.zeros(1)
    taps, variance = np.ones(1), covariance[0]
    best, smallest = taps / np.sqrt(variance), samples * np.log(variance)
    for order in range(1, longest + 1):
        reflection = -float(taps @ covariance[order:0:-1]) / variance
        taps = np.append(taps, 0.0)
        taps = taps + reflection * taps[::-1]
        variance *= 1.0 - reflection**2
        if variance <= 0.0:
            break
        criterion = samples * np.log(variance) + order * np.log(samples)
        if criterion < smallest:
            best, smallest = taps / np.sqrt(variance), criterion
    return np.asarray(best)


def whitening_filters(errors: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the filter of each output; see `whitening_filter`."""
    outputs = errors[0].shape[1]
    return [whitening_filter([e[:, output] for e in errors]) for output in range(outputs)]


def whitened(errors: FloatArray, filters: Sequence[FloatArray]) -> FloatArray:
    """Return errors, (samples, outputs), behind their filters; NaN where one reaches a missing."""
    passed = [np.convolve(e, taps)[: len(e)] for e, taps in zip(errors.T, filters, strict=True)]
    return np.stack(passed, axis=1)


def is_noise(errors: Sequence[FloatArray], inputs: Sequence[FloatArray], lags: int = _LAGS) -> bool:
    """Return whether white errors are uncorrelated with the inputs of the samples before them.

    Parameters
    ----------
    errors : sequence of ndarray, (samples, outputs)
        Whitened errors of each record; NaN where there is none.
    inputs : sequence of ndarray, (samples, inputs)
        Inputs of each record.
    lags : int
        Number of samples.
    """
    size = lags * inputs[0].shape[1]
    gram, cross, samples = np.zeros((size, size)), np.zeros((size, errors[0].shape[1])), 0
    power = np.zeros(errors[0].shape[1])
    for e, u in zip(errors, inputs, strict=True):
        if len(e) <= lags:
            continue
        unknown = lags + np.flatnonzero(np.isnan(e[lags:]).any(axis=1))
        present = e[lags:].copy()
        present[unknown - lags] = 0.0
        gram += _lag_products(u, lags)
        for lag in range(1, lags + 1):
            rows = slice((lag - 1) * u.shape[1], lag * u.shape[1])
            cross[rows] += u[lags - lag : len(u) - lag].T @ present
        if len(unknown):
            past = np.hstack([u[unknown - lag] for lag in range(1, lags + 1)])
            gram -= past.T @ past
        power += np.sum(present**2, axis=0)
        samples += len(present) - len(unknown)
    if samples <= size or not np.all(power > 0.0):
        return False
    inverse = truncated_inverse(gram, equilibrated=True)
    explained = np.sum(cross * inverse.solve(cross), axis=0) / power
    degrees = inverse.rank * len(power)
    return bool(scipy.special.chdtrc(degrees, samples * explained.sum()) > _SIGNIFICANCE)


def _lag_products(u: FloatArray, lags: int) -> FloatArray:
    """Return the products of the inputs of the samples before a sample, over all of them.

    Those of two lags differ from those of the lags before them by the ends of the sums.
    """
    count, r = len(u), u.shape[1]

    def edge(row: int, lag: int) -> FloatArray:
        others = u[row - np.arange(lags - 1)]
        return np.asarray(u[row - lag][:, np.newaxis] * others[:, np.newaxis])

    products = np.empty((lags, lags, r, r))
    latest = u[lags - 1 : count - 1].T
    for lag in range(lags):
        products[0, lag] = latest @ u[lags - 1 - lag : count - 1 - lag]
        products[lag, 0] = products[0, lag].T
    for lag in range(lags - 1):
        products[lag + 1, 1:] = products[lag, :-1] + edge(lags - 2, lag) - edge(count - 2, lag)
    return products.transpose(0, 2, 1, 3).reshape(lags * r, lags * r)
