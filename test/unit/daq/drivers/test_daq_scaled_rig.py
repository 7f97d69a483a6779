from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.rig_description import described
from flexarm_daq.drivers.scaled_rig import ScaledRig
from flexarm_daq.rigs.rig_protocol import RigError, RigSample

if TYPE_CHECKING:
    from collections.abc import Sequence

RIG = described(
    """
name: two
rate_hz: 500
inputs:
  first: {quantity: torque, unit: N m, limits: 3, raw_per_unit: 2048}
  second: {quantity: torque, unit: N m, limits: 1, raw_per_unit: -0.5}
outputs:
  tip: {unit: x, scale: 0.5, offset: 10}
  a: {quantity: angle, unit: deg, scale: -0.1, offset: 1800, range: [-180, 180], wrap: 360}
  b: {quantity: angle, unit: rad, range: [0, 8], wrap: 8}
  none: {unit: x, absent: true}
driver: rig.py:Mine
"""
)


class Readings:
    """Driver that reads the rows it is given, and keeps what is written."""

    def __init__(self, rows: Sequence[Sequence[float]]) -> None:
        self.rows = list(rows)
        self.written: list[list[float]] = []
        self.absent_channels = ("tip",)

    def open(self) -> None:
        pass

    def read(self) -> RigSample:
        return RigSample(0.0, np.array(self.rows.pop(0)))

    def write(self, commands: Sequence[float]) -> None:
        self.written.append(list(commands))

    def safe_stop(self) -> None:
        self.written.append([0.0, 0.0])

    def close(self) -> None:
        self.safe_stop()


def test_commands___that_a_driver_reports___are_in_the_units_of_the_inputs() -> None:
    driver = Readings([])
    driver.read = lambda: RigSample(0.0, np.zeros(4), (1024.0, 0.25))  # type: ignore[method-assign]
    assert ScaledRig(driver, RIG).read().commands == (0.5, -0.5)


def values(driver: Readings) -> np.ndarray:
    rig = ScaledRig(driver, RIG)
    rig.open()
    return np.array([rig.read().outputs for _ in range(len(driver.rows))])


def of_encoders(*rows: tuple[float, float]) -> Readings:
    """Return a driver whose encoders read degrees and units of their own."""
    return Readings([(10.0, 1800.0 - 10.0 * a, b, 0.0) for a, b in rows])


def test_reading___of_the_driver___is_scaled_from_its_offset() -> None:
    found = values(Readings([(14.0, 1000.0, 2.5, 7.0)]))
    np.testing.assert_allclose(found, [[2.0, 80.0, 2.5, 7.0]])


def test_command___in_the_rigs_units___reaches_the_driver_in_its_own() -> None:
    driver = Readings([])
    ScaledRig(driver, RIG).write([1.5, 0.25])
    np.testing.assert_allclose(driver.written, [[3072.0, -0.125]])


def test_absent_channels___of_the_file_and_of_the_driver___are_both_known() -> None:
    assert set(ScaledRig(Readings([]), RIG).absent_channels) == {"tip", "none"}


def test_encoders___that_begin_anew___go_on_each_by_its_own_wrap() -> None:
    found = values(
        of_encoders((170.0, 1.0), (-170.0, 7.5), (-20.0, 3.6), (130.0, 7.5), (-90.0, 3.6))
    )
    np.testing.assert_allclose(found[:, 1], [170.0, 190.0, 340.0, 490.0, 630.0])
    # Down past zero, back up, and back again: by less than half of 8 from sample to sample.
    np.testing.assert_allclose(found[:, 2], [1.0, -0.5, -4.4, -0.5, -4.4])


def test_encoder___that_jumps_by_less_than_half_a_turn___has_not_begun_anew() -> None:
    found = values(of_encoders((-89.0, 1.0), (90.0, 4.9), (-89.0, 1.0)))
    np.testing.assert_allclose(found[:, 1], [-89.0, 90.0, -89.0])
    np.testing.assert_allclose(found[:, 2], [1.0, 4.9, 1.0])


def test_encoder___of_a_rig_that_is_opened_again___counts_its_turns_from_there() -> None:
    driver = of_encoders((170.0, 1.0), (-170.0, 1.0), (160.0, 1.0))
    rig = ScaledRig(driver, RIG)
    rig.open()
    rig.read()
    assert rig.read().outputs[1] == pytest.approx(190.0)
    rig.open()
    assert rig.read().outputs[1] == pytest.approx(160.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_encoder___after_a_reading_that_is_not_a_number___keeps_its_turns(bad: float) -> None:
    found = values(of_encoders((170.0, 1.0), (-170.0, 1.0), (bad, 1.0), (-160.0, 1.0)))
    np.testing.assert_allclose(found[[0, 1, 3], 1], [170.0, 190.0, 200.0])
    assert not math.isfinite(found[2, 1])
    first = values(of_encoders((bad, 1.0), (-170.0, 1.0), (170.0, 1.0)))
    np.testing.assert_allclose(first[1:, 1], [-170.0, -190.0])


def test_driver___of_fewer_channels___is_refused_with_the_outputs() -> None:
    rig = ScaledRig(Readings([(1.0, 2.0)]), RIG)
    with pytest.raises(RigError, match="reads 2 channels, and the rig has 4 outputs: tip, a, b, n"):
        rig.read()
