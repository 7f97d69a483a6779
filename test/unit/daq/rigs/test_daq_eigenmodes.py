from __future__ import annotations

import numpy as np
import pytest

from flexarm_daq.rigs.beam import eigenmodes


def test_eigenmodes___of_a_chain_of_equal_masses___are_the_closed_form() -> None:
    # Free at both ends: omega_j = 2 sin(j pi / 2 n), shapes cos(j pi (k + 1/2) / n).
    n = 20
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stiffness[0, 0] = stiffness[-1, -1] = 1.0
    squares, shapes = eigenmodes(stiffness, np.eye(n), 6, bandwidth=1)
    modes = np.arange(1, 7)
    assert squares == pytest.approx(4.0 * np.sin(modes * np.pi / (2 * n)) ** 2, rel=1e-12)
    expected = np.sqrt(2.0 / n) * np.cos(np.outer(np.arange(n) + 0.5, modes) * np.pi / n)
    assert shapes * np.sign(shapes[0]) == pytest.approx(expected, abs=1e-12)
