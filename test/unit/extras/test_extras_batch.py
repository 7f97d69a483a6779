from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.rigs.plant import Plant, simulate
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_daq.rigs.simulated import SimulatedRig
from flexarm_extras.batch import RigBatch

if TYPE_CHECKING:
    from numpy.typing import NDArray

SAMPLES = 520
"""More than two blocks of noise."""
RIGS = (
    RigParameters(),
    RigParameters(payload_kg=0.4, loop_delay_s=0.0),
    RigParameters(payload_kg=0.2, hum_v=(0.1, 0.2, 0.1, 0.0), adc_bits=10, dac_bits=8),
)


def at_rest(rigs: tuple[RigParameters, ...] = RIGS) -> RigBatch:
    batch = RigBatch(len(rigs))
    for rig, parameters in enumerate(rigs):
        batch.rest(rig, parameters, seed=10 + rig)
    return batch


def squares(rigs: int) -> NDArray[np.float64]:
    """Return commands that clip, swing and stop, others for each rig, (samples, rigs)."""
    sample, rig = np.arange(SAMPLES)[:, np.newaxis], np.arange(rigs)
    swing: NDArray[np.float64] = np.where(sample // (40 + 10 * rig) % 2 == 0, 3.0, -2.5) + 0.01
    swing[:30] *= 5.0
    swing[-100:] = 0.0
    return swing


def all_moving(batch: RigBatch) -> NDArray[np.bool_]:
    return np.ones(len(batch.command_v), np.bool_)


@pytest.mark.parametrize("rig", range(len(RIGS)))
def test_each_rig___reads_what_a_simulated_rig_reads(rig: int) -> None:
    batch, command_v = at_rest(), squares(len(RIGS))
    single = SimulatedRig(RIGS[rig], seed=10 + rig)
    single.open()
    for sample in range(SAMPLES):
        # The rig's periods are differences of instants, with their rounding.
        np.testing.assert_allclose(batch.read()[rig], single.read().outputs, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(batch.outputs_v[rig], single.outputs_v(), rtol=0.0, atol=1e-9)
        batch.write(command_v[sample], all_moving(batch))
        single.write([command_v[sample, rig]])


def test_commands_of_a_converter_s_steps___move_as_one_call_does() -> None:
    fine = RigParameters(payload_kg=0.2)
    step_v = 10.0 / 2**fine.dac_bits
    command_v = np.rint(squares(1)[:, 0].clip(-9.0, 9.0) / step_v) * step_v
    batch = at_rest((fine,))
    found_v = np.empty((SAMPLES, 4))
    for sample in range(SAMPLES):
        found_v[sample] = batch.outputs_v[0]
        batch.write(command_v[sample : sample + 1], all_moving(batch))
    np.testing.assert_allclose(found_v, simulate(Plant(fine), command_v, 300.0), atol=1e-12)


@pytest.mark.slow
def test_many_rigs_in_blocks___move_as_each_of_them_alone() -> None:
    delays_s = np.random.default_rng(0).choice([0.0, 1e-4, 1e-3], 41)
    rigs = tuple(
        RigParameters(payload_kg=0.01 * rig, backlash_deg=0.02 * (rig % 5), loop_delay_s=delay_s)
        for rig, delay_s in enumerate(delays_s.tolist())
    )
    # The arm reaches its stops: a long push, then the other way.
    command_v = np.where(np.arange(200) < 120, 6.0, -6.0)[:, np.newaxis] + np.arange(41) / 41.0
    step_v = 10.0 / 2 ** rigs[0].dac_bits
    command_v = np.rint(command_v / step_v) * step_v
    batch = at_rest(rigs)
    found_v = np.empty((len(command_v), len(rigs), 4))
    for sample, each_v in enumerate(command_v):
        found_v[sample] = batch.outputs_v
        batch.write(each_v, all_moving(batch))
    assert np.abs(found_v[:, :, 0]).max() > 6.8
    for rig, parameters in enumerate(rigs):
        alone_v = simulate(Plant(parameters), command_v[:, rig], 300.0)
        np.testing.assert_allclose(found_v[:, rig], alone_v, rtol=0.0, atol=1e-12)


def test_rig_that_does_not_move___stays_while_the_others_go_on() -> None:
    batch = at_rest()
    batch.write(np.full(3, 3.0), all_moving(batch))
    outputs_v, read_v = batch.outputs_v.copy(), batch.read()
    for _ in range(5):
        batch.write(np.full(3, -3.0), np.array([True, False, True]))
    np.testing.assert_array_equal(batch.outputs_v[1], outputs_v[1])
    np.testing.assert_array_equal(batch.read()[1], read_v[1])
    assert batch.samples.tolist() == [6, 1, 6]
    assert batch.command_v[1] > 2.9
    assert (batch.outputs_v[[0, 2]] != outputs_v[[0, 2]]).any()


def test_used_rig_at_rest_again___is_as_a_fresh_one() -> None:
    batch, fresh = at_rest(), at_rest()
    for command_v in squares(3)[:300]:
        batch.write(command_v, all_moving(batch))
    for rig, parameters in enumerate(RIGS):
        batch.rest(rig, parameters, seed=10 + rig)
    np.testing.assert_array_equal(batch.read(), fresh.read())
    for command_v in squares(3)[:50]:
        batch.write(command_v, all_moving(batch))
        fresh.write(command_v, all_moving(fresh))
    np.testing.assert_array_equal(batch.outputs_v, fresh.outputs_v)
    np.testing.assert_array_equal(batch.read(), fresh.read())


def test_reading_twice___gives_the_same_sample() -> None:
    batch = at_rest()
    np.testing.assert_array_equal(batch.read(), batch.read())


def test_noise_and_hum___stand_in_the_readings_and_not_in_the_outputs() -> None:
    batch = at_rest(
        (RigParameters(noise_v=(0.1, 0.2, 0.05, 0.1)), RigParameters(noise_v=(0.0,) * 4))
    )
    read_v = np.empty((2000, 2, 4))
    for sample in range(len(read_v)):
        read_v[sample] = batch.read()
        batch.write(np.zeros(2), all_moving(batch))
    assert not batch.outputs_v.any()
    # The standard error of a deviation from 2000 samples is 1.6 %.
    np.testing.assert_allclose(read_v[:, 0].std(0), [0.1, 0.2, 0.05, 0.1], rtol=0.1)
    assert not read_v[:, 1].any()


def test_no_rig_or_no_rate___is_refused() -> None:
    with pytest.raises(SettingError, match="rigs must be at least 1, got 0"):
        RigBatch(0)
    with pytest.raises(SettingError, match="rate_hz must be positive, got nan"):
        RigBatch(1, rate_hz=np.nan)


def test_delay_of_a_period___is_refused() -> None:
    with pytest.raises(SettingError, match="loop_delay_s must be less than the period"):
        RigBatch(1).rest(0, RigParameters(loop_delay_s=1.0 / 300.0), seed=0)


@pytest.mark.parametrize("command_v", [[1.0, 2.0], [1.0, np.nan, 0.0], [np.inf, 0.0, 0.0]])
def test_commands_that_drives_do_not_have___are_refused_and_move_nothing(
    command_v: list[float],
) -> None:
    batch = at_rest()
    with pytest.raises(SettingError, match="command_v must be 3 finite numbers"):
        batch.write(np.array(command_v), all_moving(batch))
    assert not batch.samples.any()
