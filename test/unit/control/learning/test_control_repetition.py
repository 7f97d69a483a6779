"""Learning beside the flat model in a loop, where each repetition leaves a known part."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_control.laws.gains import PdpGains
from flexarm_control.learning.repetition import (
    LearningSettings,
    Repetition,
    best,
    improved,
    is_over,
    learned,
    repetition,
    without_model,
)
from flexarm_control.learning.trajectory import Trajectory, planned_trajectory
from flexarm_control.planning.flat_arm import ArmFigures
from flexarm_core.errors import SettingError
from support.flat_model import held

RATE_HZ = 300.0
ARM = ArmFigures().at(0.2)
GAINS = PdpGains()
SLOW = planned_trajectory(np.repeat([0.0, 2.0], 300), ARM, 0.7, RATE_HZ)
DIFFERENCES_V = st.lists(
    st.tuples(st.floats(1e-6, 10.0), st.floats(1e-6, 10.0)), min_size=1, max_size=12
)


def linear_run(_: int, played: Trajectory, *, gain: float = 1.0) -> np.ndarray:
    """Return the outputs of the flat model in its PDP loop, without friction and noise."""
    A, B, C = held(ARM, RATE_HZ)
    weights = np.array([GAINS.kp, GAINS.ksg, GAINS.kd])
    asked = np.column_stack([played.position_v, played.middle_strain_v, played.speed_v])
    state, outputs = np.zeros((4, 1)), np.zeros((len(played), 4))
    for k, command_v in enumerate(played.command_v):
        y = (C @ state).ravel()
        outputs[k, [0, 2, 3]] = y
        state = A @ state + gain * B * (command_v + weights @ (asked[k] - y))
    return outputs


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_learning___of_the_model_itself___leaves_the_share_that_is_not_taken(share: float) -> None:
    settings = LearningSettings(share=share)
    improve = partial(improved, arm=ARM, gains=GAINS, delay_s=0.5 / RATE_HZ, settings=settings)

    done = learned(
        linear_run, without_model(SLOW, GAINS), improve, repetitions=3, settings=settings
    )

    left = [each.position_rms_v for each in done]
    expected = left[0] * (1.0 - share) ** np.arange(4)
    np.testing.assert_allclose(left, expected, rtol=0.1, atol=0.004 * left[0])


def test_learning___of_an_arm_with_another_gain___ends_at_its_command() -> None:
    improve = partial(improved, arm=ARM, gains=GAINS, delay_s=0.5 / RATE_HZ)

    done = learned(partial(linear_run, gain=1.2), SLOW, improve, repetitions=8)

    kept = done[best(done)]
    assert kept.position_rms_v <= 0.03 * done[0].position_rms_v
    moving = np.abs(SLOW.command_v) > 0.5
    np.testing.assert_allclose(
        kept.played.command_v[moving], SLOW.command_v[moving] / 1.2, atol=0.03
    )


def test_learning___of_runs_that_do_not_change___stops() -> None:
    y = np.zeros((len(SLOW), 4))

    done = learned(lambda *_: y, SLOW, lambda played, _: played, repetitions=9)

    assert len(done) == 4
    assert best(done) == 0


@given(DIFFERENCES_V)
def test_best___of_any_repetitions___is_never_worse_than_the_first(
    differences_v: list[tuple[float, float]],
) -> None:
    done = [Repetition(SLOW, *each, sum(each)) for each in differences_v]

    kept = done[best(done)]

    assert kept.position_rms_v <= done[0].position_rms_v
    assert kept.weighted_v <= done[0].weighted_v
    assert is_over(done) == (len(done) - best(done) > 3)


def test_repetition___of_known_differences___has_their_root_mean_squares() -> None:
    y = np.column_stack(
        [SLOW.position_v - 0.3, SLOW.speed_v, SLOW.middle_strain_v + 0.4, 0 * SLOW.speed_v]
    )

    found = repetition(SLOW, y, LearningSettings(strain_weight=1.0))

    assert found[1:] == pytest.approx((0.3, 0.4, 0.5))


def test_repetition___of_a_record_that_ends_early___is_refused() -> None:
    with pytest.raises(SettingError, match=f"a run of {len(SLOW)} samples is needed .* got 5"):
        repetition(SLOW, np.zeros((5, 4)))
