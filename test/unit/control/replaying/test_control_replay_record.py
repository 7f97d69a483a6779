"""Records of controlled runs in bags, and what is said of bags that cannot be replayed."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_control.loop_setup import Setup, parameters_in
from flexarm_control.models.nominal_models import identified_model
from flexarm_control.replaying.comparison import NOT_RECORDED, answered_rows, read_loop, replay
from flexarm_core.errors import BagError, SettingError
from flexarm_ident.models.files import save_model
from support.bag_samples import (
    START_NS,
    arm_state,
    commander_info,
    io_sample,
    motor_command,
    write_bag,
)
from support.controlled_loop import pd_parameters, pd_run

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from support.bag_samples import Sent

SAMPLES = 50


def test_record___of_a_bag___is_that_of_the_run(tmp_path: Path) -> None:
    run = pd_run(SAMPLES)
    bag = write_bag(tmp_path / "bag", run.messages(SAMPLES))

    found, expected = read_loop(bag), run.record(SAMPLES)

    for name in (
        "sequence",
        "stamps_ns",
        "volts",
        "drive",
        "command_sequence",
        "answered",
        "answers",
    ):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.laws == expected.laws
    assert replay(found).compared == SAMPLES


def test_sample_and_command_in_one_nanosecond___are_sample_and_answer() -> None:
    numbers, sent_ns = np.array([1, 2, 1, 2]), np.array([10, 20, 30, 40])
    answers, answered_ns = np.array([1, 2, 1, 2]), np.array([10, 20, 30, 40])

    rows = answered_rows((numbers, sent_ns), (answers, answered_ns))

    assert rows.tolist() == [0, 1, 2, 3]


def test_second_answer_to_a_sample___is_no_step_of_the_law() -> None:
    run = pd_run(SAMPLES)
    record = run.record(SAMPLES)
    answers = [1, 2, 2, 3]

    rows = answered_rows(
        (record.sequence[:3], record.stamps_ns[:3]),
        (np.array(answers), record.stamps_ns[[0, 1, 1, 2]] + 5),
    )

    assert rows.tolist() == [0, 1, NOT_RECORDED, 2]


ONE = [arm_state(1, START_NS), motor_command(1, START_NS + 1000, 0.0)]


@pytest.mark.parametrize(
    ("messages", "complaint"),
    [
        ([io_sample(1, START_NS, [0.0], [0.0])], "has no commands"),
        (ONE[:1], r"has no commands \(/flexarm/command\)"),
        (ONE, r"has no law \(/flexarm/law\): it was recorded by an older version"),
        (
            [commander_info(START_NS, uses_outputs=False), *ONE],
            "was recorded in open loop: no controller made its commands",
        ),
        (
            [commander_info(START_NS, uses_outputs=True), *ONE],
            "has no law",
        ),
    ],
)
def test_bag___without_what_a_replay_needs___is_refused_with_what_it_lacks(
    tmp_path: Path, messages: Sequence[Sent], complaint: str
) -> None:
    bag = write_bag(tmp_path / "bag", messages)

    with pytest.raises(BagError, match=f"^{bag}: {complaint}"):
        read_loop(bag)


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"law": "pd"}, "without law or reference"),
        (pd_parameters(1.0, **{"pd.kq": 1.0}), "no parameter pd.kq: it was recorded by another"),
        (pd_parameters(9.0), "pd.kp = 9 is outside 0 to 5 V/V"),
        (pd_parameters(1.0) | {"pd.kp": 10**400}, r"pd.kp = 1000+\.\.\.0+ is outside 0 to 5 V/V"),
        (pd_parameters(1.0) | {"pd.kd": "much"}, "parameter pd.kd must be a float"),
        (pd_parameters(1.0) | {"pd.kd": True}, "parameter pd.kd must be a float"),
        (pd_parameters(1.0) | {"law": "magic"}, "law = 'magic': must be one of pd"),
    ],
)
def test_bag___with_parameters_that_no_law_has___is_refused(
    tmp_path: Path, parameters: dict[str, Any], complaint: str
) -> None:
    run = pd_run(3)
    run.laws[0] = replace(run.laws[0], parameters=parameters)
    bag = write_bag(tmp_path / "bag", run.messages(3))

    with pytest.raises(BagError, match=f"^{bag}: /flexarm/law: .*{complaint}"):
        read_loop(bag)


def test_parameters___that_are_no_json___are_refused() -> None:
    for text in ("{", "[" * 100_000, "3"):
        with pytest.raises(SettingError, match="the parameters of the law are"):
            parameters_in(text)


def test_parameters___of_a_version_with_one_weight_for_all_states___are_those_of_a_list() -> None:
    reported = [
        Setup.of(parameters_in(json.dumps({"law": "ilqr", "reference": "topic", name: value})))
        for name, value in (("ilqr.states", 0.02), ("ilqr.states", [0.02]))
    ]

    answers = [each.law.step((1.0, 0.1, 0.1, 0.2), 3.0) for each in reported]
    assert answers[0] == pytest.approx(answers[1], rel=1e-9)


def test_parameters___of_a_law_on_a_model_file___have_the_model_and_not_its_place(
    tmp_path: Path,
) -> None:
    file = tmp_path / "my arm.json"
    save_model(file, identified_model(), name="printed", provenance={})
    values = {"law": "lqg", "reference": "topic", "lqg.model": str(file), "lqg.effort": 0.5}

    reported = Setup.of(values | {"pd.kp": 2.0}).text

    assert str(tmp_path) not in reported
    assert json.loads(reported)["lqg.model"] == "my_arm"
    file.unlink()
    again = Setup.of(parameters_in(reported))
    assert again.text == reported
    assert again.rate_hz == pytest.approx(300.0, rel=1e-3)


def test_answers___of_two_runs_with_the_same_numbers___belong_to_their_own() -> None:
    numbers, sent_ns = np.array([1, 2, 3, 1, 2]), np.array([10, 20, 30, 100, 110])

    rows = answered_rows((numbers, sent_ns), (np.array([1, 2, 1, 2]), np.array([11, 21, 101, 111])))

    assert rows.tolist() == [0, 1, 3, 4]


def test_answers___to_samples_that_are_not_there___have_no_row() -> None:
    numbers, sent_ns = np.array([1, 2, 3, 1, 4]), np.array([10, 20, 30, 100, 120])

    # The fourth answers sample 2 of the second run, which was lost: not that of the first run.
    rows = answered_rows(
        (numbers, sent_ns), (np.array([1, 9, 1, 2, 4]), np.array([11, 21, 101, 111, 121]))
    )

    assert rows.tolist() == [0, NOT_RECORDED, 3, NOT_RECORDED, 4]
