"""Arm of the bench `mujoco` in both engines, and its figures of a vibration."""

from __future__ import annotations

import numpy as np
import pytest

from bench.control.mujoco import free_response, vibration


@pytest.mark.parametrize(("frequency_hz", "damping"), [(1.4, 0.002), (2.3, 0.05)])
def test_vibration___of_one_mode___is_found(frequency_hz: float, damping: float) -> None:
    time_s = np.arange(1500) / 300.0
    angular = 2.0 * np.pi * frequency_hz
    signal = np.exp(-damping * angular * time_s) * np.sin(angular * time_s + 0.3)

    found_hz, found = vibration(signal, 300.0)

    assert found_hz == pytest.approx(frequency_hz, rel=1e-3)
    # The decay to a period is 2 pi D / sqrt(1 - D^2), by the instants of a decaying sine.
    assert found == pytest.approx(damping / np.sqrt(1.0 - damping**2), rel=0.02, abs=1e-4)


def test_friction___of_both_engines___stops_and_holds_the_hub_alike() -> None:
    pytest.importorskip("mujoco", reason="the engine: requirements/mujoco.in")
    engine, simulated = (free_response(arm, 0.2) for arm in ("mujoco", "plain"))

    assert engine.modes_hz == pytest.approx(simulated.modes_hz, rel=0.01)
    assert engine.stops_deg == pytest.approx(simulated.stops_deg, rel=0.02)
    assert engine.rings_hz == pytest.approx(simulated.rings_hz, rel=0.02)
    # A hub that creeps would damp it a hundred times as much.
    assert max(engine.damping_ratio, simulated.damping_ratio) < 0.005
    assert engine.moves_at_v == pytest.approx(simulated.moves_at_v, rel=0.01)
