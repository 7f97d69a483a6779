"""Records from topics of common types, as other programs record them."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from flexarm_core.errors import BagError
from flexarm_ident import read_channels, selection
from support.bag_samples import FOREIGN_FORMATS, START_NS
from support.foreign_bags import (
    JOINTS,
    MS_NS,
    every_ms,
    float64,
    float64_arrays,
    header,
    joint_states,
    topic,
    two_joints,
    wrenches,
    write_topics,
)

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3


@pytest.mark.parametrize(("storage", "compression"), FOREIGN_FORMATS)
def test_read___joint_states___input_acts_from_its_own_sample_on(
    tmp_path: Path, storage: StoragePlugin, compression: CompressionMode
) -> None:
    bag = write_topics(tmp_path / "run", [two_joints(50)], storage, compression)
    chosen = selection(
        ["torque_nm=/joint_states.effort[motor]"],
        ["/joint_states.position[shoulder]", "/joint_states.position[1]"],
    )

    data = read_channels(bag, chosen)

    k = np.arange(50.0)
    np.testing.assert_array_equal(data.u, (5000.0 + k)[:, np.newaxis])
    np.testing.assert_array_equal(data.y, np.column_stack([1000.0 + k, 2000.0 + k]))
    assert data.inputs == ("torque_nm",)
    assert data.outputs == ("joint_states_position_shoulder", "joint_states_position_1")
    assert (data.dt_s, data.closed_loop, data.notices) == (0.01, None, ())
    assert data.source == str(bag)


def test_read___database_without_definitions___takes_the_common_ones(tmp_path: Path) -> None:
    # Recorders before Iron wrote none.
    bag = write_topics(tmp_path / "run", [two_joints(20)], SQLITE)
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("DELETE FROM message_definitions")
    data = read_channels(
        bag, selection(["/joint_states.effort[motor]"], ["/joint_states.position[motor]"])
    )
    assert data.u[:3, 0].tolist() == [5000.0, 5001.0, 5002.0]


def test_read___joints_in_another_order_and_of_two_nodes___are_found_by_name(
    tmp_path: Path,
) -> None:
    # Messages of a gripper, with another number of joints, come between those of the arm, whose
    # joints change places.
    count = 40
    times_ns = every_ms(10, count)
    swapped = [("b", "a") if number % 3 == 0 else ("a", "b") for number in range(count)]
    arm = topic(
        "/joint_states",
        "sensor_msgs/msg/JointState",
        times_ns,
        (
            {
                "header": header(int(stamp)),
                "name": list(names),
                "position": np.array([{"a": 1.0, "b": -1.0}[name] * number for name in names]),
                "velocity": np.empty(0),
                "effort": np.array([{"a": 10.0, "b": 20.0}[name] + number for name in names]),
            }
            for number, (stamp, names) in enumerate(zip(times_ns, swapped, strict=True))
        ),
    )
    gripper = joint_states(every_ms(25, 16, 3.0), ["finger"], np.full((16, 1), 7.0))
    bag = write_topics(tmp_path / "run", [arm, gripper], MCAP)

    data = read_channels(bag, selection(["/joint_states.effort[b]"], ["/joint_states.position[a]"]))

    np.testing.assert_array_equal(data.y[:, 0], np.arange(40.0))
    np.testing.assert_array_equal(data.u[:, 0], 20.0 + np.arange(40.0))


def test_read___elements_of_messages_in_a_list___have_paths(tmp_path: Path) -> None:
    drive = float64_arrays("/drive", every_ms(10, 30), np.outer(np.arange(30.0), [1.0, -2.0]))
    bag = write_topics(tmp_path / "run", [drive], MCAP)
    data = read_channels(bag, selection(["/drive.data[1]"], ["/drive.layout.dim[0].size"]))
    assert data.u[:3, 0].tolist() == [0.0, -2.0, -4.0]
    assert set(data.y[:, 0]) == {2.0}


def test_read___command_between_samples___acts_for_its_part_of_the_period(tmp_path: Path) -> None:
    # By hand: command k comes 2.5 ms after sample k. For a quarter of the period the one before
    # acts. The first sample has no command yet.
    count = 30
    command = float64("/command", every_ms(10, count, 2.5), 100.0 * np.arange(float(count)))
    angle = float64("/angle", every_ms(10, count), np.arange(float(count)))
    bag = write_topics(tmp_path / "run", [command, angle], SQLITE)

    data = read_channels(bag, selection(["/command.data"], ["/angle.data"]))

    np.testing.assert_array_equal(data.y[:, 0], np.arange(1.0, 30.0))
    k = np.arange(1.0, 30.0)
    np.testing.assert_allclose(data.u[:, 0], 0.25 * 100.0 * (k - 1) + 0.75 * 100.0 * k)
    (notice,) = data.notices
    assert notice.code == "sampling"
    assert "as /command (std_msgs/msg/Float64) has no header stamps" in notice.text


def test_read___set_points_sent_when_they_change___hold_to_the_end(tmp_path: Path) -> None:
    at_ms, levels = np.array([-30.0, 50.0, 180.0]), np.array([1.0, 4.0, -2.0])
    times_ns = START_NS + (at_ms * MS_NS).astype(np.int64)
    angle = float64("/angle", every_ms(10, 60), np.arange(60.0))
    bag = write_topics(tmp_path / "run", [float64("/set", times_ns, levels), angle], MCAP)
    data = read_channels(bag, selection(["/set.data"], ["/angle.data"]))
    times_ms = 10.0 * np.arange(60)
    expected = levels[np.searchsorted(at_ms, times_ms, side="right") - 1]
    np.testing.assert_array_equal(data.u[:, 0], expected)
    assert [notice.code for notice in data.notices] == ["sampling"]


def test_read___measured_input___runs_on_lines(tmp_path: Path) -> None:
    # The mean of a parabola over a period, between its samples 2 ms apart, in closed form: the
    # trapezia are h^2 / 6 above the curve, for the second derivative 2.
    def force(t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(t_s**2)

    sampled_ns = every_ms(2, 400, -10.0)
    felt = wrenches("/ft", sampled_ns, force((sampled_ns - START_NS) / 1e9))
    bag = write_topics(tmp_path / "run", [felt, two_joints(50)], MCAP)
    chosen = selection(["/ft.wrench.force.x"], ["/joint_states.position[motor]"], interpolated=True)
    data = read_channels(bag, chosen)
    start_s = 0.01 * np.arange(50.0)
    exact = ((start_s + 0.01) ** 3 - start_s**3) / 0.03 + 0.002**2 / 6.0
    np.testing.assert_allclose(data.u[:, 0], exact, atol=1e-12)
    assert data.notices == ()


def test_read___clocks___differ_by_the_delay(tmp_path: Path) -> None:
    # The force is sensed at 0, 10, .. ms and received 4 ms later, the states without delay.
    count = 40
    k = np.arange(float(count))
    late_ns = every_ms(10, count, 4.0)
    felt = wrenches("/ft", every_ms(10, count), 100.0 * k, received_ns=late_ns)
    bag = write_topics(tmp_path / "run", [felt, two_joints(count)], MCAP)
    names = (["/ft.wrench.force.x"], ["/joint_states.position[motor]"])

    by_default = read_channels(bag, selection(*names))
    by_header = read_channels(bag, selection(*names, clock="header"))
    received = read_channels(bag, selection(*names, clock="receive"))

    np.testing.assert_array_equal(by_header.u[:, 0], 100.0 * k)
    np.testing.assert_array_equal(by_default.u, by_header.u)
    np.testing.assert_allclose(received.u[:, 0], 100.0 * (0.4 * (k[1:] - 1) + 0.6 * k[1:]))
    np.testing.assert_array_equal(received.y[:, 0], 2000.0 + k[1:])
    assert (by_header.notices, received.notices) == ((), ())


def test_read___stamps_that_stand___take_the_other_clock(tmp_path: Path) -> None:
    never = np.zeros(30, dtype=np.int64)
    felt = wrenches("/ft", never, np.arange(30.0), received_ns=every_ms(10, 30))
    bag = write_topics(tmp_path / "run", [felt, two_joints(30)], MCAP)
    names = (["/ft.wrench.force.x"], ["/joint_states.position[motor]"])
    data = read_channels(bag, selection(*names))
    np.testing.assert_array_equal(data.u[:, 0], np.arange(30.0))
    assert "as /ft (geometry_msgs/msg/WrenchStamped) has no header" in data.notices[0].text
    with pytest.raises(BagError, match=r"/ft \(geometry_msgs.* no header stamps .* receive"):
        read_channels(bag, selection(*names, clock="header"))


def test_read___slower_output___is_read_off_between_its_samples(tmp_path: Path) -> None:
    # 2 Hz at 40 Hz: a cubic spline is off by (h omega)^4 / 384 at most, 2.5e-5.
    def wave(times_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.asarray(np.sin(2.0 * np.pi * 2.0 * (times_ns - START_NS) / 1e9))

    slow_ns = every_ms(25, 80, 3.0)
    felt = wrenches("/ft", slow_ns, wave(slow_ns))
    bag = write_topics(tmp_path / "run", [felt, two_joints(200)], SQLITE)
    chosen = selection(
        ["/joint_states.effort[0]"], ["/ft.wrench.force.x", "/joint_states.position[0]"]
    )
    data = read_channels(bag, chosen)
    # From the first row behind its first sample on: 10 ms.
    times_ns = every_ms(10, len(data), 10.0)
    assert data.missing is None
    np.testing.assert_array_equal(data.y[:, 1], 1001.0 + np.arange(len(data)))
    # The ends of a spline have no neighbours on one side.
    np.testing.assert_allclose(data.y[10:-10, 0], wave(times_ns)[10:-10], atol=3e-5)
    (notice,) = data.notices
    assert notice.code == "sampling"
    assert "/ft.wrench.force.x at 40 Hz in a record of 100 Hz" in notice.text


def test_read___output_with_a_pause___lacks_it(tmp_path: Path) -> None:
    felt_ns = every_ms(10, 200, 4.0)
    felt_ns = felt_ns[(np.arange(200) < 80) | (np.arange(200) >= 120)]
    felt = wrenches("/ft", felt_ns, np.sin((felt_ns - START_NS) / 1e8))
    bag = write_topics(tmp_path / "run", [felt, two_joints(200)], MCAP)
    chosen = selection(
        ["/joint_states.effort[0]"], ["/joint_states.position[0]", "/ft.wrench.force.x"]
    )
    data = read_channels(bag, chosen)
    # Row 0 is at 10 ms; the force lacks what lies between 794 and 1204 ms.
    expected = np.arange(80 - 1, 120)
    np.testing.assert_array_equal(np.flatnonzero(~data.usable), expected)


def test_read___arrivals_with_jitter___count_as_sent_evenly(tmp_path: Path) -> None:
    count = 600
    k = np.arange(float(count))
    delays_ns = np.random.default_rng(1).gamma(2.0, 1.5e6, (2, count)).astype(np.int64)
    arrived = [np.sort(every_ms(10, count) + each) for each in delays_ns]
    command, angle = float64("/command", arrived[0], k), float64("/angle", arrived[1], k)
    bag = write_topics(tmp_path / "run", [command, angle], MCAP)
    data = read_channels(bag, selection(["/command.data"], ["/angle.data"]))
    assert data.dt_s == 0.01
    # Both are late by the same in the mean: all commands act from their own sample on.
    np.testing.assert_array_equal(data.u, data.y)
    assert [notice.code for notice in data.notices] == ["sampling", "sampling"]


def test_read___lost_commands___are_reported(tmp_path: Path) -> None:
    kept = np.delete(np.arange(300), [50, 51, 170])
    felt = wrenches("/ft", every_ms(10, 300)[kept], kept.astype(np.float64))
    bag = write_topics(tmp_path / "run", [felt, two_joints(300)], MCAP)
    data = read_channels(bag, selection(["/ft.wrench.force.x"], ["/joint_states.position[motor]"]))
    assert data.u[49:53, 0].tolist() == [49.0, 49.0, 49.0, 52.0]
    (notice,) = data.notices
    assert (notice.code, dict(notice.figures)) == ("lost_samples", {"lost": 3.0})


def test_read___clock_that_begins_anew___takes_the_longest_run(tmp_path: Path) -> None:
    count = 90
    stamps_ns = every_ms(10, count)
    stamps_ns[60:] = every_ms(10, 30, -5000.0)
    states = joint_states(
        stamps_ns,
        ["a"],
        np.arange(float(count))[:, np.newaxis],
        efforts=np.ones((count, 1)),
        received_ns=every_ms(10, count),
    )
    bag = write_topics(tmp_path / "run", [states], MCAP)
    data = read_channels(bag, selection(["/joint_states.effort[0]"], ["/joint_states.position[0]"]))
    np.testing.assert_array_equal(data.y[:, 0], np.arange(60.0))
    assert {notice.code for notice in data.notices} == {"partial_record"}


def test_read___topics_that_begin_late___are_cut_to_what_they_share(tmp_path: Path) -> None:
    command = wrenches("/ft", every_ms(10, 100, 500.0), np.arange(100.0))
    bag = write_topics(tmp_path / "run", [command, two_joints(100)], MCAP)
    data = read_channels(bag, selection(["/ft.wrench.force.x"], ["/joint_states.position[0]"]))
    assert (data.u[0, 0], data.y[0, 0], len(data)) == (0.0, 1050.0, 50)
    (notice,) = data.notices
    assert notice.text.startswith("0.5 s of 1.0 s are used")


def test_read___pause_of_the_commands___has_an_unknown_input(tmp_path: Path) -> None:
    kept = np.delete(np.arange(300), [*range(100, 120), 170])
    felt = wrenches("/ft", every_ms(10, 300)[kept], kept.astype(np.float64))
    bag = write_topics(tmp_path / "run", [felt, two_joints(300)], MCAP)
    data = read_channels(bag, selection(["/ft.wrench.force.x"], ["/joint_states.position[motor]"]))
    assert data.input_held is not None
    # Command 99 was in force for its period. A single lost one may be held.
    assert np.flatnonzero(data.input_held).tolist() == list(range(100, 120))


def test_read___commands_sent_when_they_change___are_known_throughout(tmp_path: Path) -> None:
    kept = np.sort(np.random.default_rng(2).choice(300, 40, replace=False))
    felt = wrenches("/ft", every_ms(10, 300)[kept], kept.astype(np.float64))
    bag = write_topics(tmp_path / "run", [felt, two_joints(300)], MCAP)
    data = read_channels(bag, selection(["/ft.wrench.force.x"], ["/joint_states.position[motor]"]))
    assert data.input_held is None


def test_read___input_with_values_that_are_no_numbers___is_reported(tmp_path: Path) -> None:
    commands = np.arange(300.0)
    commands[::10] = np.nan
    sent = float64("/command", every_ms(10, 300), commands)
    bag = write_topics(tmp_path / "run", [sent, two_joints(300)], MCAP)
    chosen = selection(["/command.data"], ["/joint_states.position[motor]"], clock="receive")
    data = read_channels(bag, chosen)
    (notice,) = [each for each in data.notices if each.code == "lost_samples"]
    assert dict(notice.figures) == {"values": 30.0}
    assert "30 of 300 values of /command.data are not numbers" in notice.text


def test_read___commands_of_which_every_tenth_lacks___keep_their_instants(tmp_path: Path) -> None:
    k = np.arange(300)
    kept = k[k % 10 > 0]
    sent = float64("/command", every_ms(10, 300)[kept], kept.astype(np.float64))
    bag = write_topics(tmp_path / "run", [sent, two_joints(300)], MCAP)
    data = read_channels(bag, selection(["/command.data"], ["/joint_states.position[motor]"]))
    # The value before a lost one acts on.
    k = k[1:]
    np.testing.assert_allclose(data.u[:, 0], np.where(k % 10, k, k - 1), atol=1e-6)
    lost = [each for each in data.notices if each.code == "lost_samples"]
    assert [dict(each.figures) for each in lost] == [{"lost": 29.0}]


@pytest.mark.parametrize("rate", [1e-3, -4e-3])
def test_read___header_clocks_that_drift_apart___takes_the_recorders(
    tmp_path: Path, rate: float
) -> None:
    true_ns = every_ms(10, 3000)
    received_ns = true_ns + np.random.default_rng(1).integers(MS_NS, 2 * MS_NS, 3000)
    drifting_ns = START_NS + np.rint((1.0 + rate) * (true_ns - START_NS)).astype(np.int64)
    k = np.arange(3000.0)
    topics = [
        wrenches("/ft", true_ns, k, received_ns=received_ns),
        joint_states(drifting_ns, JOINTS, np.column_stack([k, k]), received_ns=received_ns),
    ]
    bag = write_topics(tmp_path / "run", topics, MCAP)
    signals = ["/ft.wrench.force.x"], ["/joint_states.position[motor]"]

    data = read_channels(bag, selection(*signals))

    np.testing.assert_allclose(data.u, data.y, atol=0.1)
    (notice,) = data.notices
    assert notice.figures["apart_s"] == pytest.approx(30.0 * abs(rate), rel=0.02)
    (kept,) = (
        each
        for each in read_channels(bag, selection(*signals, clock="header")).notices
        if "apart_s" in each.figures
    )
    assert kept.grade == "caution"


@pytest.mark.parametrize(("rate", "word"), [(4e-3, "0.4 % faster"), (-4e-3, "0.4 % slower")])
def test_read___header_clock_of_another_rate___is_reported(
    tmp_path: Path, rate: float, word: str
) -> None:
    true_ns = every_ms(10, 300)
    stamps_ns = START_NS + np.rint((1.0 + rate) * (true_ns - START_NS)).astype(np.int64)
    k = np.arange(300.0)
    values = np.column_stack([k, k])
    states = joint_states(stamps_ns, JOINTS, values, efforts=values, received_ns=true_ns)
    bag = write_topics(tmp_path / "run", [states], MCAP)
    chosen = selection(["/joint_states.effort[motor]"], ["/joint_states.position[motor]"])
    (notice,) = read_channels(bag, chosen).notices
    assert word in notice.text
