"""ARX models with an order by Akaike's criterion, as a peer of the identification.

Ljung, "System Identification", 2nd ed., Prentice Hall (1999), section 4.2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import control
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_ident import IoData

    Array = NDArray[np.float64]

LARGEST_ORDER = 20
# Rows of the regression for each of its columns.
_ROWS_PER_COLUMN = 3


def arx(data: IoData) -> control.StateSpace:
    """Return the ARX model whose order, with a direct term or without, has the smallest AIC.

    All orders are judged by the same samples.
    """
    u, y = data.u, data.y
    (samples, outputs), inputs = y.shape, u.shape[1]
    most = max(1, min(LARGEST_ORDER, samples // (_ROWS_PER_COLUMN * (outputs + inputs))))
    found = []
    for order in range(1, most + 1):
        lags = [y[most - lag : samples - lag] for lag in range(1, order + 1)]
        lags += [u[most - lag : samples - lag] for lag in range(order + 1)]
        regressors, now = np.hstack(lags), y[most:]
        for direct in (False, True):
            # The input of the same sample is the first after the outputs.
            first = outputs * order
            columns = (
                regressors if direct else np.delete(regressors, range(first, first + inputs), 1)
            )
            theta = np.linalg.lstsq(columns, now, rcond=None)[0]
            error = now - columns @ theta
            spread = np.linalg.slogdet(error.T @ error / len(error))[1]
            criterion = len(error) * spread + 2.0 * theta.size
            whole = theta if direct else np.insert(theta, [first] * inputs, 0.0, axis=0)
            found.append((criterion, order, whole))
    _, order, theta = min(found, key=lambda each: each[0])
    return _realised(np.asarray(theta, dtype=np.float64), order, outputs, inputs, data.dt_s)


def _realised(
    theta: Array, order: int, outputs: int, inputs: int, dt_s: float
) -> control.StateSpace:
    """Return the observer form of the model with coefficients of y at lags from 1, u from 0 on."""
    own = theta[: outputs * order].reshape(order, outputs, outputs).transpose(0, 2, 1)
    driven = theta[outputs * order :].reshape(order + 1, inputs, outputs).transpose(0, 2, 1)
    D, states = driven[0], outputs * order
    A = np.eye(states, k=outputs)
    A[:, :outputs] = own.reshape(states, outputs)
    B = (driven[1:] + own @ D).reshape(states, inputs)
    C = np.eye(outputs, states)
    return control.ss(A, B, C, D, dt_s)
