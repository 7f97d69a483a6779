"""Law behind a reference shaper: what it follows, live changes, memory and setup."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_control import Effort, Pdp, PdpGains, build_law
from flexarm_control.laws.law_protocol import Memoryless
from flexarm_control.laws.payload import PayloadEstimate
from flexarm_control.laws.switching import FADE_V, Handover
from flexarm_control.loop_setup import Setup, parameters_in
from flexarm_control.models.nominal_models import identified_model, nominal_model
from flexarm_control.models.rigid_and_bending import bending_modes
from flexarm_control.shaping.shaped_law import ShapedLaw, Vibrations, nominal_vibrations
from flexarm_control.shaping.shapers import SHAPERS, Vibration, shaper_parts
from flexarm_core.errors import SettingError
from flexarm_ident.models.files import save_model

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

RATE_HZ = 300.0
MODE = Vibration(9.4, 0.03)
ONE = Vibrations((0.0,), (MODE,))
STILL = (0.5, 0.0, 0.0, 0.0)


class Followed(Memoryless):
    """Law whose effort is its reference."""

    def step(self, _volts: Sequence[float], reference_v: float) -> Effort:
        return Effort(reference_v, 0.0)


def shaped(name: str = "zvd") -> ShapedLaw:
    """Return a shaped law, reset as at the beginning of a run."""
    law = ShapedLaw(Followed(), name, ONE, rate_hz=RATE_HZ)
    law.reset()
    return law


def followed(law: ShapedLaw, references_v: Sequence[float]) -> list[float]:
    """Return what the law inside follows."""
    return [law.step(STILL, each).effort_v for each in references_v]


@pytest.mark.parametrize("name", SHAPERS)
def test_shaped_law___from_the_arms_position___gets_the_sums_of_the_parts(name: str) -> None:
    found = followed(shaped(name), [3.0] * 100)

    sums = np.cumsum(shaper_parts(name, MODE, 1 / RATE_HZ))
    assert found[: len(sums)] == pytest.approx((0.5 + 2.5 * sums).tolist())
    # Exactly the reference, without what the sum rounds.
    assert set(found[len(sums) - 1 :]) == {3.0}


def test_shaped_law___changes_within_a_shaper___add_up() -> None:
    references_v = [0.5] * 3 + [3.0] * 7 + [-1.0] * 4 + [2.0] * 60

    found = followed(shaped(), references_v)

    changes = np.diff([0.5, *references_v])
    convolved = np.convolve(changes, shaper_parts("zvd", MODE, 1 / RATE_HZ))[: len(changes)]
    assert found == pytest.approx((0.5 + np.cumsum(convolved)).tolist())


def test_shaped_law___in_place_of_another___begins_at_the_reference() -> None:
    law = ShapedLaw(Followed(), "zvd", ONE, rate_hz=RATE_HZ)

    assert followed(law, [3.0] * 5) == [3.0] * 5


def test_shaped_law___put_in_or_taken_out_in_mid_move___lets_no_command_jump() -> None:
    gains = PdpGains(1.0, 0.0, 0.0)
    handover = Handover(ShapedLaw(Pdp(gains), "zv", ONE, rate_hz=RATE_HZ))
    handover.reset()
    commands_v = [sum(handover.step(STILL, 0.5)) for _ in range(5)]
    commands_v += [sum(handover.step(STILL, 3.0)) for _ in range(3)]
    before = len(commands_v)

    for law in (Pdp(gains), ShapedLaw(Pdp(gains), "jerk", ONE, rate_hz=RATE_HZ)):
        handover.replace(law)
        commands_v += [sum(handover.step(STILL, 3.0)) for _ in range(40)]

    steps_v = [abs(after - this) for this, after in pairwise(commands_v[before - 1 :])]
    assert max(steps_v) <= FADE_V + 1e-9
    assert commands_v[-1] == pytest.approx(2.5)


def test_shaped_law___a_payload_in_mid_move___counts_from_the_next_move_on() -> None:
    light, heavy = Vibration(9.4, 0.0), Vibration(7.0, 0.0)
    estimate = PayloadEstimate(0.0, 1.0, detected=False)
    law = ShapedLaw(
        Followed(),
        "zv",
        Vibrations((0.0, 0.4), (light, heavy)),
        rate_hz=RATE_HZ,
        payload=lambda: estimate,
    )
    law.reset()
    found = followed(law, [3.5] * 5)
    estimate = PayloadEstimate(0.4, 0.01, detected=True)
    found += followed(law, [3.5] * 50)
    later = followed(law, [0.5] * 55)

    for mode, values, start_v, change_v in (
        (light, found, 0.5, 3.0),
        (heavy, later, 3.5, -3.0),
    ):
        sums = np.cumsum(shaper_parts("zv", mode, 1 / RATE_HZ))
        assert values[: len(sums)] == pytest.approx((start_v + change_v * sums).tolist())


def test_shaped_law___with_the_memory_of_another___goes_on_as_that_one() -> None:
    first, second = (
        Handover(ShapedLaw(build_law("pdpc_plus"), "jerk", ONE, rate_hz=RATE_HZ)) for _ in "ab"
    )
    first.reset()
    for k in range(70):
        first.step(STILL, 0.1 * (k // 7))

    second.remember({name: list(group) for name, group in first.memory().items()})

    expected = [first.step(STILL, 1.0 if k > 80 else 0.3) for k in range(200)]
    assert [second.step(STILL, 1.0 if k > 80 else 0.3) for k in range(200)] == expected


def test_shaped_law___numbers_that_are_none___are_left_to_the_law() -> None:
    law = ShapedLaw(Pdp(), "zv", ONE, rate_hz=RATE_HZ)
    law.reset()

    for volts, reference_v in (((math.nan, 0.0, 0.0, 0.0), 3.0), (STILL, math.inf)):
        assert law.step(volts, reference_v) == Effort(0.0, 0.0)
    assert law.step(STILL, 0.5) == Pdp().step(STILL, 0.5)


def test_shaped_law___sampled_too_slowly___is_refused() -> None:
    with pytest.raises(SettingError, match=r"a vibration of 30 Hz at 50 samples a second"):
        ShapedLaw(Followed(), "zv", Vibrations((0.0,), (Vibration(30.0, 0.0),)), rate_hz=50.0)


def test_nominal_vibrations___between_two_payloads___lie_between_theirs() -> None:
    (light_hz, *_), _ = bending_modes(nominal_model(0.0))
    (medium_hz, *_), _ = bending_modes(nominal_model(0.2))

    assert nominal_vibrations().at(0.1).frequency_hz == pytest.approx(0.5 * (light_hz + medium_hz))
    assert nominal_vibrations().at(2.0) == nominal_vibrations().at(0.4)


VALUES = {"law": "pdpc", "reference": "topic", "shaper": "zv"}


@pytest.mark.parametrize(
    ("values", "first_part"),
    [
        ({}, nominal_vibrations().at(0.0)),
        ({"shaper_payload_kg": 0.4}, nominal_vibrations().at(0.4)),
    ],
)
def test_setup___with_a_shaper___takes_the_printed_vibration_of_the_payload(
    values: dict[str, Any], first_part: Vibration
) -> None:
    setup = Setup.of({**VALUES, "pdpc.kp": 1.0, **values})
    setup.law.reset()

    first = setup.law.step((0.0, 0.0, 0.0, 0.0), 3.0)

    part = shaper_parts("zv", first_part, 1 / RATE_HZ)[0]
    assert first.effort_v == pytest.approx(3.0 * part)
    assert setup.rate_hz == RATE_HZ
    assert Setup.of(parameters_in(setup.text)).text == setup.text


def test_setup___with_a_shaper_for_a_model___has_the_model_and_not_its_place(
    tmp_path: Path,
) -> None:
    file = tmp_path / "my arm.json"
    save_model(file, identified_model(), name="printed", provenance={})
    values = {**VALUES, "law": "lqg", "shaper_model": str(file), "lqg.model": str(file)}

    reported = Setup.of(values).text

    assert str(tmp_path) not in reported
    assert json.loads(reported)["shaper_model"] == "shaper_my_arm"
    file.unlink()
    assert Setup.of(parameters_in(reported)).text == reported


def test_setup___of_a_shaper_at_another_rate___says_what_to_set() -> None:
    with pytest.raises(SettingError, match=r"made for 500 Hz .* at 300 Hz: set shaper_rate_hz"):
        Setup.of({**VALUES, "shaper_rate_hz": 500.0}).check_rate(300.0)


def test_setup___of_an_older_bag___is_without_a_shaper() -> None:
    assert Setup.of({"law": "pdpc", "reference": "topic"}).rate_hz is None
