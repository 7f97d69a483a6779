from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from flexarm_bags.writer import BagWriter
from flexarm_ident.reading.read import read_bag, read_bag_report
from flexarm_ident.records.iodata import ARM_OUTPUTS
from flexarm_ident.records.preprocess import preprocess
from support.bag_samples import (
    FOREIGN_FORMATS,
    START_NS,
    STEP_NS,
    arm_state,
    channel_info,
    commander_info,
    io_reference,
    io_sample,
    mcap_file,
    motor_command,
    open_loop,
    outputs,
    recorded_topics,
    reference,
    rig_description,
    typestore,
    write_bag,
    write_foreign_bag,
)

if TYPE_CHECKING:
    from pathlib import Path


def test_read___own_rig___takes_the_input_from_the_sample_that_follows(tmp_path: Path) -> None:
    # By hand: while sample 2 was taken 102 V were in force. They were the answer to sample 1 and
    # act from sample 1 to sample 2, so they belong into the row of sample 1.
    bag = write_bag(tmp_path / "run", open_loop([1, 2, 3, 4]))

    reading = read_bag_report(bag)

    data = reading.data
    assert data.y.tolist() == [list(outputs(1)), list(outputs(2)), list(outputs(3))]
    assert data.u.tolist() == [[102.0], [103.0], [104.0]]
    assert data.compensation is not None
    assert data.compensation.tolist() == [[1.0], [1.5], [2.0]]
    assert (data.inputs, data.outputs) == (("command_v",), ARM_OUTPUTS)
    assert (data.dt_s, data.closed_loop, data.reference) == (0.002, None, None)
    assert data.source == str(bag)
    assert (reading.samples, reading.lost, reading.warnings) == (4, 0, ())
    assert reading.duration_s == pytest.approx(0.006)


@pytest.mark.parametrize(
    ("in_force", "unanswered"),
    [
        ([0, 1, 2, 3, 4], 0),
        ([0, 0, 0, 0, 0], 4),
        # The second sample got no answer: what answered the first one stayed.
        ([0, 7, 7, 8, 9], 1),
        # The watchdog let go; the answer to the fourth sample is a new commander's.
        ([5, 6, 6, 0, 1], 2),
        # A newer answer has overtaken the third command: each sample has one of its own.
        ([0, 1, 2, 4, 5], 0),
    ],
)
def test_read___unanswered___are_the_samples_without_a_command_of_their_own(
    tmp_path: Path, in_force: list[int], unanswered: int
) -> None:
    states = [
        arm_state(k, START_NS + k * STEP_NS, outputs(k), command_sequence=command)
        for k, command in enumerate(in_force, start=1)
    ]

    assert read_bag_report(write_bag(tmp_path / "run", states)).unanswered == unanswered


def test_read___reference___is_the_last_one_sent_before_the_next_sample(tmp_path: Path) -> None:
    states = open_loop([1, 2, 3, 4, 5])
    first, _, third, fourth, _ = (state.time_ns for state in states)
    messages = [
        *states,
        reference(first - 5, 1.0),
        reference(third + 100, 2.0),
        # At the very instant of sample 4 it cannot have answered sample 3.
        reference(fourth, 3.0),
    ]
    bag = write_bag(tmp_path / "run", messages)

    data = read_bag(bag)

    assert data.reference is not None
    assert data.reference.tolist() == [1.0, 1.0, 2.0, 3.0]


TWO_JOINTS = """\
name: two
rate_hz: 500
inputs: {a: {unit: V, limits: 5}, b: {unit: V, limits: 5}}
outputs: {strain: {quantity: strain, unit: V, per_si: 1, range: 5}, p: {unit: rad}, q: {unit: deg}}
joints: {one: {input: a, angle: p, travel: 1}, two: {input: b, angle: q, travel: 90}}
tracked: TRACKED
driver: twin
"""


@pytest.mark.parametrize("tracked", [("p", "q"), ("q",)])
def test_read___set_points_of_another_rig___are_those_of_its_tracked_outputs(
    tmp_path: Path, tracked: tuple[str, ...]
) -> None:
    text = TWO_JOINTS.replace("TRACKED", f"[{', '.join(tracked)}]")
    text = text.replace("{unit: rad}", "{quantity: angle, unit: rad}")
    text = text.replace("{unit: deg}", "{quantity: angle, unit: deg}")
    times_ns = [START_NS + k * STEP_NS for k in range(4)]
    places, goals = [0.1, 20.0][-len(tracked) :], [0.5, -45.0][-len(tracked) :]
    sent = [
        channel_info(times_ns[0], ["a", "b"], ["strain", "p", "q"], 500.0),
        rig_description(times_ns[0], text),
        io_reference(times_ns[0] - 5, *places),
        # It follows the second sample.
        io_reference(times_ns[1] + 100, *goals),
        *(
            io_sample(1 + k, time_ns, [1.0, 2.0], [0.0, 0.1, 20.0], [0.0, 0.0])
            for k, time_ns in enumerate(times_ns)
        ),
    ]

    data = read_bag(write_bag(tmp_path / "run", sent))

    assert data.tracked == tracked
    assert data.reference is not None
    assert data.reference.shape == ((3,) if len(tracked) == 1 else (3, 2))
    assert data.reference.reshape(3, -1).tolist() == [places, goals, goals]
    # Units and offsets of each set-point are those of its output.
    rest = preprocess(data, bias="first").reference
    assert rest is not None
    assert rest.reshape(3, -1)[0].tolist() == [0.0] * len(tracked)


def test_read___reference_only_later___takes_it_before_too(tmp_path: Path) -> None:
    states = open_loop([1, 2, 3, 4, 5])
    bag = write_bag(tmp_path / "run", [*states, reference(states[2].time_ns + 1, 2.0)])

    reading = read_bag_report(bag)

    assert reading.data.reference is not None
    assert reading.data.reference.tolist() == [2.0] * 4


@pytest.mark.parametrize(
    ("declared", "closed_loop"),
    [([], None), ([False], False), ([True], True), ([False, True], True)],
)
def test_read___commanders___say_the_kind_of_loop(
    tmp_path: Path, declared: list[bool], *, closed_loop: bool | None
) -> None:
    states = [*open_loop([1, 2, 3]), motor_command(1, START_NS, 1.0)]
    said = [commander_info(START_NS + k, uses_outputs=uses) for k, uses in enumerate(declared)]

    assert read_bag(write_bag(tmp_path / "run", [*said, *states])).closed_loop is closed_loop


@pytest.mark.parametrize(("storage", "compression"), FOREIGN_FORMATS)
def test_read___foreign_bag___gives_the_same_record(
    tmp_path: Path, storage: StoragePlugin, compression: CompressionMode
) -> None:
    messages = [*open_loop(range(1, 60)), reference(START_NS, 0.5), motor_command(1, START_NS, 1.0)]
    ours = read_bag(write_bag(tmp_path / "ours", messages))

    theirs = read_bag(write_foreign_bag(tmp_path / "run", messages, storage, compression))

    np.testing.assert_array_equal(theirs.u, ours.u)
    np.testing.assert_array_equal(theirs.y, ours.y)
    np.testing.assert_array_equal(theirs.compensation, ours.compensation)
    np.testing.assert_array_equal(theirs.reference, ours.reference)
    assert (theirs.dt_s, theirs.closed_loop) == (ours.dt_s, ours.closed_loop)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_read___single_file___needs_no_folder(tmp_path: Path, storage: StoragePlugin) -> None:
    bag = write_foreign_bag(tmp_path / "run", open_loop([1, 2, 3]), storage)
    (file,) = (entry for entry in bag.iterdir() if entry.suffix in {".mcap", ".db3"})

    assert read_bag(file).u.tolist() == [[102.0], [103.0]]


def test_read___split_bag___joins_the_parts(tmp_path: Path) -> None:
    first = write_bag(tmp_path / "first", open_loop([1, 2, 3]))
    second = write_bag(tmp_path / "second", open_loop([4, 5]))
    text = (first / "metadata.yaml").read_text()
    text = text.replace("- first_0.mcap\n", "- first_0.mcap\n  - second_0.mcap\n", 1)
    (first / "metadata.yaml").write_text(text)
    mcap_file(second).rename(first / "second_0.mcap")

    assert read_bag(first).u[:, 0].tolist() == [102.0, 103.0, 104.0, 105.0]


def test_read___many_chunks_and_frames___keep_the_order(tmp_path: Path) -> None:
    # Frame names of several lengths move the numbers to other places in the message.
    frames = ["", "a", "flexarm", "a_rather_long_frame_name"]
    messages = [
        arm_state(k, START_NS + k * STEP_NS, outputs(k), frame_id=frames[k % 4])
        for k in range(1, 200)
    ]
    with BagWriter(tmp_path / "run", recorded_topics(messages), flush_period_s=1e6) as bag:
        for count, message in enumerate(messages):
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
            if count % 7 == 0:
                bag.flush()

    assert read_bag(tmp_path / "run").y[:, 0].tolist() == [float(k) for k in range(1, 199)]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(
        st.tuples(
            *[st.floats(allow_nan=False, allow_infinity=False)] * 6, st.sampled_from(["", "abc"])
        ),
        min_size=3,
        max_size=12,
    )
)
@pytest.mark.slow
def test_read___any_values___are_those_of_the_rosbags_deserialiser(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]]
) -> None:
    messages = [
        arm_state(
            k + 1,
            START_NS + k * STEP_NS,
            row[:4],
            command_v=row[4],
            compensation_v=row[5],
            frame_id=str(row[6]),
        )
        for k, row in enumerate(rows)
    ]

    data = read_bag(write_bag(tmp_path_factory.mktemp("bag") / "run", messages))
    fields = [
        vars(typestore().deserialize_cdr(message.raw, message.type_name)) for message in messages
    ]

    assert data.y.tolist() == [[entry[name] for name in ARM_OUTPUTS] for entry in fields[:-1]]
    assert data.u[:, 0].tolist() == [entry["command_v"] for entry in fields[1:]]
    assert data.compensation is not None
    assert data.compensation[:, 0].tolist() == [entry["compensation_v"] for entry in fields[1:]]


def test_read___gaps___are_filled_and_the_input_before_them_is_held(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", open_loop([1, 2, 5, 6, 7, 8, 10, 11]))

    reading = read_bag_report(bag)

    # The outputs go up by one from sample to sample, and so does what fills the holes.
    np.testing.assert_allclose(reading.data.y[:, 0], range(1, 11), rtol=1e-12)
    assert reading.data.missing is not None
    assert np.flatnonzero(reading.data.missing[:, 0]).tolist() == [2, 3, 8]
    assert reading.data.u[:, 0].tolist() == [102, 105, 105, 105, 106, 107, 108, 110, 110, 111]
    assert (reading.samples, reading.lost) == (8, 3)
    assert reading.warnings == (
        (
            "3 of 11 periods are without a sample, in 2 holes, the longest from 0.004 s (row 2) to "
            "0.006 s (row 3): those of up to 3 samples were filled"
        ),
    )


def test_read___restart_of_the_numbering___is_a_gap_without_loss(tmp_path: Path) -> None:
    states = open_loop([7, 8, 9])
    restarted = [
        arm_state(k, START_NS + (20 + k) * STEP_NS, outputs(k), command_v=100.0 + k)
        for k in (1, 2, 3, 4)
    ]

    reading = read_bag_report(write_bag(tmp_path / "run", [*states, *restarted]))

    assert reading.data.y[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert reading.lost == 0


@pytest.mark.parametrize(
    ("period_ns", "dt_s"),
    [
        (3_333_333, 1 / 300),
        (2_000_900, 1 / 500),
        (32_894_737, 0.032894737),
        (10**9, 1.0),
    ],
)
def test_period___near_a_whole_rate___is_that_rate(
    tmp_path: Path, period_ns: int, dt_s: float
) -> None:
    states = [arm_state(k, START_NS + k * period_ns) for k in range(1, 6)]

    assert read_bag(write_bag(tmp_path / "run", states)).dt_s == pytest.approx(dt_s, rel=1e-12)


def test_period___one_period_without_sample___does_not_move_it_and_is_reported(
    tmp_path: Path,
) -> None:
    late_ns = [0, 0, 0, 0, STEP_NS, STEP_NS, STEP_NS, STEP_NS]
    states = [arm_state(k + 1, START_NS + k * STEP_NS + extra) for k, extra in enumerate(late_ns)]

    reading = read_bag_report(write_bag(tmp_path / "run", states))

    assert reading.data.dt_s == pytest.approx(0.002, rel=1e-9)
    (warning,) = reading.warnings
    assert warning.startswith("1 of 9 periods is without a sample, in 1 hole, at 0.008 s (row 4): ")


def test_read___other_rig___takes_names_rate_and_loop_from_its_channel_info(
    tmp_path: Path,
) -> None:
    info = channel_info(START_NS, ["a", "b"], ["q"], 500.0)
    samples = [
        io_sample(k, START_NS + k * STEP_NS, [1.0 * k, 2.0 * k], [3.0 * k]) for k in (1, 2, 3)
    ]
    bag = write_bag(tmp_path / "run", [info, *samples])

    reading = read_bag_report(bag)

    data = reading.data
    assert data.u.tolist() == [[1.0, 2.0], [2.0, 4.0], [3.0, 6.0]]
    assert data.y.tolist() == [[3.0], [6.0], [9.0]]
    assert (data.inputs, data.outputs) == (("a", "b"), ("q",))
    assert (data.dt_s, data.closed_loop) == (0.002, True)
    assert data.source == f"{bag} (another rig)"
    assert (reading.samples, reading.lost, reading.warnings) == (3, 0, ())


def test_read___other_rig_without_channel_info___numbers_the_channels_and_warns(
    tmp_path: Path,
) -> None:
    samples = [io_sample(k, START_NS + k * STEP_NS, [1.0], [2.0, 3.0]) for k in (1, 2)]

    reading = read_bag_report(write_bag(tmp_path / "run", samples))

    assert reading.data.inputs == ("input_1",)
    assert reading.data.outputs == ("output_1", "output_2")
    assert reading.data.closed_loop is None
    assert reading.warnings == ()


def test_read___channel_info_with_another_rate___believes_the_stamps(tmp_path: Path) -> None:
    info = channel_info(START_NS, ["a"], ["q"], 100.0)
    samples = [io_sample(k, START_NS + k * STEP_NS, [1.0], [2.0]) for k in (1, 2, 3)]

    reading = read_bag_report(write_bag(tmp_path / "run", [info, *samples]))

    assert reading.data.dt_s == pytest.approx(0.002, rel=1e-9)
    assert reading.warnings == ("ChannelInfo says 100 Hz, the stamps 500 Hz: used the stamps",)
