from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.errors import SettingError
from flexarm_core.rig_description import load_rig
from flexarm_daq.loop.limiter import LimiterSettings, arm_gate
from flexarm_daq.loop.self_test import (
    PULSE,
    RIGHT,
    SATURATED,
    SILENT,
    WRONG_SIGN,
    SelfTestError,
    check_possible,
    complaint,
    judge,
    profile,
    run_self_test,
)
from flexarm_daq.rigs.nidaq.board import NidaqRig
from flexarm_daq.rigs.nidaq.terminals import NidaqSettings
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, THESIS_NOISE_V, RigParameters
from flexarm_daq.rigs.rig_protocol import Rig, RigError, RigSample
from flexarm_daq.rigs.simulated import SimulatedRig
from support.exhaustive import first_of
from support.nidaq_board import Board
from support.nidaqmx_double import NidaqmxDouble

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Wiring = Callable[[NDArray[np.float64]], NDArray[np.float64]]

NOISES_V = {"low": LOW_NOISE_V, "thesis": THESIS_NOISE_V, "none": (0.0, 0.0, 0.0, 0.0)}
RATE_HZ = 300.0
THESIS = load_rig("thesis")
(HUB,) = THESIS.joints
PULSE_V = PULSE * THESIS.inputs[0].reach


class Rewired:
    """A simulated rig whose four voltages pass through `wiring`, and what it was told to do."""

    def __init__(self, wiring: Wiring, rig: Rig | None = None, drive: float = 1.0) -> None:
        self._rig = rig if rig is not None else SimulatedRig(rate_hz=RATE_HZ)
        self._wiring = wiring
        self._drive = drive
        self.written_v: list[float] = []
        self.is_open = False
        self.absent_channels: tuple[str, ...] = ()

    def open(self) -> None:
        self._rig.open()
        self.is_open = True

    def read(self) -> RigSample:
        sample = self._rig.read()
        return RigSample(sample.time_s, self._wiring(sample.outputs.copy()))

    def write(self, commands: Sequence[float]) -> None:
        (command_v,) = commands
        self.written_v.append(command_v)
        self._rig.write([self._drive * command_v])

    def safe_stop(self) -> None:
        self._rig.safe_stop()

    def close(self) -> None:
        self._rig.close()
        self.is_open = False


def scaled(channel: int, factor: float, offset_v: float = 0.0) -> Wiring:
    def wire(volts: NDArray[np.float64]) -> NDArray[np.float64]:
        volts[channel] = factor * volts[channel] + offset_v
        return volts

    return wire


def run(rig: Rig, rate_hz: float = RATE_HZ, limits: LimiterSettings | None = None) -> None:
    run_self_test(rig, arm_gate(limits), THESIS, rate_hz, paced=False)


@pytest.mark.parametrize("rate_hz", first_of([300.0, 200.0, 500.0]))
@pytest.mark.parametrize("noise", NOISES_V)
@pytest.mark.parametrize("payload_kg", first_of([0.0, 0.4, 0.1, 0.2, 0.3], 2))
def test_healthy_rig___is_not_refused(payload_kg: float, noise: str, rate_hz: float) -> None:
    parameters = RigParameters(payload_kg=payload_kg, noise_v=NOISES_V[noise])
    for seed in range(8):
        run(SimulatedRig(parameters, rate_hz=rate_hz, seed=seed), rate_hz)


@pytest.mark.parametrize("noise", first_of(NOISES_V))
@pytest.mark.parametrize("payload_kg", first_of([0.0, 0.4]))
@pytest.mark.parametrize("channel", range(4))
def test_inverted_channel___is_refused_by_name(channel: int, payload_kg: float, noise: str) -> None:
    parameters = RigParameters(payload_kg=payload_kg, noise_v=NOISES_V[noise])
    for seed in range(4):
        rig = Rewired(scaled(channel, -1.0), SimulatedRig(parameters, seed=seed))
        with pytest.raises(SelfTestError) as raised:
            run(rig)
        assert str(raised.value) == (
            f"self-test: {CHANNEL_NAMES[channel]} (ACH{channel}) answers the current with the "
            "wrong sign: swap its wires"
        )
        assert not rig.is_open


@pytest.mark.parametrize("absent", range(4))
def test_channel_without_a_sensor___is_no_fault_and_the_others_are_judged(absent: int) -> None:
    rig = Rewired(scaled(absent, 0.0), SimulatedRig(seed=1))
    rig.absent_channels = (CHANNEL_NAMES[absent],)
    run(rig)
    broken = (absent + 1) % 4
    both = Rewired(scaled(broken, -1.0), rig)
    both.absent_channels = rig.absent_channels
    reported = rf"^self-test: {CHANNEL_NAMES[broken]} \(ACH{broken}\) answers .* the wrong sign"
    with pytest.raises(SelfTestError, match=reported):
        run(both)


@pytest.mark.parametrize("noise_v", first_of([0.05, 0.0]))
@pytest.mark.parametrize("channel", range(4))
def test_dead_channel___is_refused_by_name(channel: int, noise_v: float) -> None:
    random = np.random.default_rng(1)

    def wire(volts: NDArray[np.float64]) -> NDArray[np.float64]:
        volts[channel] = 0.3 + noise_v * random.standard_normal()
        return volts

    with pytest.raises(
        SelfTestError, match=rf"^self-test: {CHANNEL_NAMES[channel]} \(ACH{channel}\) does not"
    ):
        run(Rewired(wire))


@pytest.mark.parametrize("end_v", [9.995, -10.0])
@pytest.mark.parametrize("channel", [1, 2, 3])
def test_saturated_channel___is_refused_by_name(channel: int, end_v: float) -> None:
    with pytest.raises(SelfTestError, match=rf"{CHANNEL_NAMES[channel]} .* end of the input range"):
        run(Rewired(scaled(channel, 0.0, end_v)))


def test_swapped_gauges___are_both_refused() -> None:
    with pytest.raises(SelfTestError, match=r"base_strain_v \(ACH1\).*middle_strain_v \(ACH2\)"):
        run(Rewired(lambda volts: volts[[0, 2, 1, 3]]))


def test_inverted_drive___is_distinguished_from_inverted_channels() -> None:
    with pytest.raises(SelfTestError, match=r"every channel.*direction \(DAC1\) is inverted"):
        run(Rewired(lambda volts: volts, drive=-1.0))


def test_drive_without_power___is_distinguished_from_dead_channels() -> None:
    with pytest.raises(SelfTestError, match=r"no channel answers.*magnitude \(DAC0\)"):
        run(Rewired(lambda volts: volts, drive=0.0))


def test_arm_far_from_the_middle___is_refused_before_anything_moves() -> None:
    rig = Rewired(scaled(0, 1.0, -5.2))
    with pytest.raises(SelfTestError, match=r"position_v \(ACH0\) reads -5\.\d+ V: turn the arm"):
        run(rig)
    assert not any(rig.written_v)


def test_arm_that_runs_away___ends_the_pulse_and_is_refused() -> None:
    rig = Rewired(scaled(0, 12.0))
    with pytest.raises(SelfTestError, match=r"ACH0\) moved by more than 1\.5 V at a small pulse"):
        run(rig)
    assert 0 < np.count_nonzero(rig.written_v) < round(0.1 * RATE_HZ)
    assert not rig.is_open


def test_arm_that_moves_by_itself___is_refused_before_anything_is_driven() -> None:
    position_v = iter(np.arange(0.0, 3.0, 0.05))
    rig = Rewired(lambda volts: np.array([next(position_v), *volts[1:]]))
    with pytest.raises(SelfTestError, match=r"more than 1\.5 V with the drive at zero"):
        run(rig)
    assert not any(rig.written_v)


def test_rig_fails___error_goes_on_and_the_rig_is_closed() -> None:
    class Breaking(Rewired):
        def read(self) -> RigSample:
            if len(self.written_v) == 80:
                raise RigError("broken")
            return super().read()

    rig = Breaking(lambda volts: volts)
    with pytest.raises(RigError, match="broken"):
        run(rig)
    assert not rig.is_open


def test_pulses___stay_small_and_turn_the_arm_by_a_few_degrees() -> None:
    positions_v: list[float] = []

    def note(volts: NDArray[np.float64]) -> NDArray[np.float64]:
        positions_v.append(float(volts[0]))
        return volts

    rig = Rewired(note)
    run(rig)
    assert rig.written_v[-1] == 0.0
    assert np.abs(rig.written_v).max() == PULSE_V
    assert np.ptp(positions_v) < 10.0 * 3.0 / 35.0


def test_limits___hold_for_the_pulses() -> None:
    rig = Rewired(lambda volts: volts)
    run(rig, limits=LimiterSettings(max_slew_v_per_s=60.0))
    assert np.abs(np.diff(rig.written_v)).max() <= 60.0 / RATE_HZ + 1e-12


@pytest.mark.parametrize("low_is_positive", [False, True])
def test_board___direction_as_configured_passes___other_is_refused(
    *, low_is_positive: bool
) -> None:
    for high_is_positive in (True, False):
        board = Board(low_is_positive=low_is_positive)
        rig = NidaqRig(
            NidaqSettings(high_is_positive=high_is_positive), nidaqmx=NidaqmxDouble(board)
        )
        if high_is_positive != low_is_positive:
            run(rig)
        else:
            with pytest.raises(SelfTestError, match="high_is_positive"):
                run(rig)
        assert board.outputs_v["Dev1/ao0"] == 0.0


def course() -> NDArray[np.float64]:
    """Return what four ideal channels do, from the definition."""
    commands_v = profile(RATE_HZ, PULSE_V)
    turned = np.cumsum(commands_v) / RATE_HZ
    return np.column_stack([turned, commands_v, -commands_v, commands_v])


def test_judge___ideal_channels_in_noise___certainty_is_that_of_a_matched_filter() -> None:
    commands_v, ideal = profile(RATE_HZ, PULSE_V), course()
    random = np.random.default_rng(2)
    noise_v = np.array([0.01, 0.5, 0.5, 0.5])
    answers = judge(commands_v, ideal + noise_v * random.standard_normal(ideal.shape), THESIS, HUB)
    assert [answer.verdict for answer in answers] == [RIGHT] * 4
    # The most that any test can see in white noise: energy of the signal over the noise.
    best = np.sqrt(np.sum(ideal**2, axis=0)) / noise_v
    certainties = [answer.certainty for answer in answers]
    np.testing.assert_allclose(certainties[1:], best[1:], rtol=0.3)


def test_judge___noise_alone___is_silent() -> None:
    commands_v = profile(RATE_HZ, PULSE_V)
    random = np.random.default_rng(3)
    certainties = []
    for _ in range(500):
        answers = judge(commands_v, 0.1 * random.standard_normal((len(commands_v), 4)), THESIS, HUB)
        assert {answer.verdict for answer in answers} == {SILENT}
        certainties.append([answer.certainty for answer in answers])
    # In units of its own scatter, as promised; the noise is estimated from few samples.
    np.testing.assert_allclose(np.std(certainties, axis=0), 1.0, rtol=0.15)


def test_judge___each_verdict___is_of_its_own_channel() -> None:
    volts = course()
    volts[:, 1] *= -1.0
    volts[:, 2] = 0.0
    volts[:, 3] = 9.99
    answers = judge(profile(RATE_HZ, PULSE_V), volts, THESIS, HUB)
    assert [answer.verdict for answer in answers] == [RIGHT, WRONG_SIGN, SILENT, SATURATED]
    assert complaint(answers, THESIS, HUB).count(";") == 2
    right = judge(profile(RATE_HZ, PULSE_V), course(), THESIS, HUB)
    assert not complaint(right, THESIS, HUB)


@pytest.mark.parametrize("commands_v", [[0.0, 0.0, 0.0], [0.0, 2.0, 2.0], []])
def test_judge___nothing_to_compare___is_an_error(commands_v: list[float]) -> None:
    with pytest.raises(SettingError, match="two samples of rest"):
        judge(np.array(commands_v), np.zeros((len(commands_v), 4)), THESIS, HUB)


def test_check_possible___too_slow_or_too_tight___is_an_error() -> None:
    check_possible(THESIS, 200.0, 2.0)
    with pytest.raises(SettingError, match="rate_hz of 200 or more, got 150"):
        check_possible(THESIS, 150.0, 10.0)
    with pytest.raises(SettingError, match="max_command_v of 2 or more, got 1"):
        check_possible(THESIS, 300.0, 1.0)
