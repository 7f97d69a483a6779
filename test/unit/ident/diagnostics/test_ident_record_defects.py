"""Defects of single records: each is named at its size."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IoData
from flexarm_ident.diagnostics.change import changes
from flexarm_ident.diagnostics.channel_defects import constant_channels, unmeasured
from flexarm_ident.diagnostics.excitation import drive_defects
from flexarm_ident.diagnostics.input_answer import answer_defects
from flexarm_ident.diagnostics.outliers import outliers
from flexarm_ident.diagnostics.quality import assess
from flexarm_ident.diagnostics.quantisation import quantisation
from flexarm_ident.records.data_warning import DataWarning
from flexarm_ident.subspace.gram import block_gram
from support.exhaustive import first_of
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SAMPLES = 6000
DRIVES: dict[str, Callable[[np.random.Generator], Array]] = {
    "white": lambda rng: rng.normal(size=(SAMPLES, 1)),
    "coloured": lambda rng: signal.lfilter([1.0], [1.0, -0.95], rng.normal(size=(SAMPLES, 1)), 0),
    "square": lambda rng: square_wave(SAMPLES, int(rng.integers(1000))),
    "clocked": lambda rng: np.sign(np.repeat(rng.normal(size=(SAMPLES // 6, 1)), 6, axis=0)),
}
driven = pytest.mark.parametrize("drive", DRIVES)


def answer(u: Array, seed: int, model: control.StateSpace | None = None) -> IoData:
    """Return the arm's answer with two percent of noise."""
    return noisy(u, step_by_step(model or arm_model(), u), seed)


def noisy(u: Array, y: Array, seed: int) -> IoData:
    rng = np.random.default_rng(seed)
    y = y + 0.02 * y.std(axis=0) * rng.normal(size=y.shape)
    outputs = tuple(f"y{i}" for i in range(y.shape[1]))
    return IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=outputs)


def with_holes(holes: list[slice], lost: float) -> IoData:
    """Return a record with holes in its second channel, after so many lost samples in all."""
    y = np.random.default_rng(3).normal(size=(1000, 2))
    for rows in holes:
        y[rows, 1] = np.nan
    notices = (DataWarning("lost_samples", "", {"missing": lost}),) if lost else ()
    return IoData(y[::-1, 0], y, dt_s=DT_S, inputs=("u",), outputs=("p", "q"), notices=notices)


@pytest.mark.parametrize("lost", [0, 42, 43])
def test_holes_of_one_channel___are_reported_unless_all_lack_them(lost: float) -> None:
    record = with_holes([slice(100, 102), slice(200, 201), slice(300, 340)], lost)
    found = list(unmeasured(record))
    assert len(found) == (lost < 43)
    for each in found:
        assert each.channel == "q"
        assert each.text == (
            "q: 43 of 1000 periods are without a sample, in 3 holes, the longest from "
            f"{300 * DT_S:.6g} s (row 300) to {339 * DT_S:.6g} s (row 339): those of up to 3 "
            "samples were filled; 1 longer hole of 40 samples in all, at most 40 each, cannot be "
            "filled: the parts between are used"
        )
        assert (each.figures["missing"], each.figures["left_out"]) == (43.0, 40.0)


def test_holes_of_several_channels___are_reported_once_where_they_are_the_same() -> None:
    y = np.random.default_rng(3).normal(size=(1000, 3))
    y[100:102], y[500, 2] = np.nan, np.nan
    u = np.ones((1000, 1))
    record = IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=("p", "q", "r"))
    found = list(unmeasured(record))
    assert [(each.channel, each.text.partition(":")[0]) for each in found] == [
        ("", "p, q"),
        ("r", "r"),
    ]
    assert [each.figures["missing"] for each in found] == [2.0, 3.0]


def only(
    check: Callable[[IoData], Iterator[DataWarning]], data: IoData, name: str, channel: str = ""
) -> dict[str, float]:
    """Return the figures of the only warning."""
    (found,) = check(data)
    assert (found.code, found.channel) == (name, channel)
    return dict(found.figures)


@driven
@pytest.mark.parametrize("delay", [5, 20, 60])
def test_delay___of_the_input___is_named_with_its_samples(drive: str, delay: int) -> None:
    u = DRIVES[drive](np.random.default_rng(delay))
    late = np.vstack([np.zeros((delay, 1)), u[:-delay]])
    data = noisy(u, step_by_step(arm_model(), late), 1)
    assert only(answer_defects, data, "delay", "u")["samples"] == delay


def test_delay___of_one_input_of_two___names_that_one() -> None:
    rng = np.random.default_rng(3)
    u = rng.normal(size=(SAMPLES, 2))
    late = np.column_stack([u[:, 0], np.roll(u[:, 1], 12)])
    y = step_by_step(random_model(4), late) + 0.05 * rng.normal(size=(SAMPLES, 3))
    data = IoData(u, y, dt_s=DT_S, inputs=("now", "late"), outputs=("a", "b", "c"))
    assert only(answer_defects, data, "delay", "late")["samples"] == 12.0


def test_delay___slow_onset_of_a_chain_of_integrators___is_none() -> None:
    A = np.eye(4, k=-1) * 0.05 + 0.99 * np.eye(4)
    model = control.ss(A, np.eye(4, 1), np.eye(1, 4, k=3), 0, DT_S)
    assert not list(answer_defects(answer(DRIVES["white"](np.random.default_rng(5)), 5, model)))


@driven
def test_no_answer___output_that_is_noise___is_named(drive: str) -> None:
    rng = np.random.default_rng(6)
    data = answer(DRIVES[drive](rng), 6)
    y = data.y.copy()
    y[:, 2] = rng.normal(size=SAMPLES)
    found = only(answer_defects, noisy(data.u, y, 7), "no_answer", "y2")
    assert found["explained"] < 0.05


def test_static_gain___output_that_follows_within_the_sample___is_no_feedback() -> None:
    u = DRIVES["white"](np.random.default_rng(8))
    data = noisy(u, np.column_stack([step_by_step(arm_model(), u)[:, 0], 2.0 * u]), 8)
    found = assess([data], block_gram([data], 20))
    assert [(each.code, each.channel) for each in found] == [("no_answer", "y1")]
    assert found[0].figures["share"] == pytest.approx(1.0 - 0.02**2, abs=1e-4)


@pytest.mark.parametrize(
    ("noise", "names"), [(0.0, ["duplicated_channel", "no_answer"]), (0.3, ["no_answer"])]
)
def test_static_gain___of_all_outputs___is_no_feedback(noise: float, names: list[str]) -> None:
    rng = np.random.default_rng(9)
    u = rng.normal(size=(SAMPLES, 1))
    data = IoData(u, 3.0 * u + noise * rng.normal(size=u.shape), dt_s=DT_S, outputs=("y",))
    assert [each.code for each in assess([data], block_gram([data], 20))] == names


def test_static_gain___slow_output_under_a_slow_input___is_none() -> None:
    u = 1.0 + square_wave(SAMPLES, 10, (1500, 1600))
    y = signal.lfilter([0.01], [1.0, -0.99], u, axis=0)
    assert not [each for each in answer_defects(noisy(u, y, 10)) if "share" in each.figures]


def test_static_gain___fast_plant_under_few_moves_and_noise___is_none() -> None:
    u = square_wave(SAMPLES, 26, (300, 600))
    y = signal.lfilter([0.0, 0.6], [1.0, -0.4], u, axis=0)
    y += 0.3 * y.std() * np.random.default_rng(26).normal(size=y.shape)
    data = IoData(u, y, dt_s=DT_S, outputs=("y",))
    assert not list(answer_defects(data))


@driven
def test_outliers___twenty_of_50_deviations___are_counted(drive: str) -> None:
    rng = np.random.default_rng(11)
    data = answer(DRIVES[drive](rng), 11)
    y, rows = data.y.copy(), np.sort(rng.choice(np.arange(10, SAMPLES), 20, replace=False))
    deviation = y[:, 1].std()
    y[rows, 1] += 50.0 * deviation * rng.choice([-1.0, 1.0], 20)
    found = only(outliers, IoData(data.u, y, dt_s=DT_S), "outliers", "base_strain_v")
    # Two that lie close together do not stand alone.
    assert 16.0 <= found["count"] <= 20.0
    assert found["largest"] == pytest.approx(50.0, rel=0.1)
    assert rows[0] <= found["first_row"] < found["last_row"] <= rows[-1]


def test_outliers___pulses_of_the_input_behind_them___are_an_answer() -> None:
    u = np.zeros((SAMPLES, 1))
    u[100::500] = 1.0
    y = np.vstack([np.zeros((1, 1)), u[:-1]]) + 1e-3 * np.random.default_rng(12).normal(
        size=u.shape
    )
    assert not list(outliers(IoData(u, y, dt_s=DT_S, outputs=("y",))))


@driven
def test_outliers___of_the_input___are_named_like_those_of_outputs(drive: str) -> None:
    data = answer(DRIVES[drive](np.random.default_rng(21)), 21)
    u = data.u.copy()
    u[[700, 1500, 2900], 0] = [3e5, -1e6, 4e4]
    spoilt = IoData(u, data.y, dt_s=DT_S, inputs=("u",), outputs=data.outputs)
    found = only(outliers, spoilt, "outliers", "u")
    assert (found["count"], found["first_row"], found["last_row"]) == (3.0, 700.0, 2900.0)


@pytest.mark.parametrize(
    ("rows", "sizes"),
    [([700, 701], [2e3, 2.1e3]), ([0], [2e3]), ([SAMPLES - 1], [2e3]), ([700, 1500], [13, -14])],
    ids=["two in a row", "the first sample", "the last one", "small ones"],
)
def test_outliers___of_a_random_input___are_found_wherever_they_stand(
    rows: list[int], sizes: list[float]
) -> None:
    data = answer(
        np.repeat(np.random.default_rng(24).normal(size=(SAMPLES // 3, 1)), 3, axis=0), 24
    )
    u = data.u.copy()
    u[rows, 0] = sizes
    spoilt = IoData(u, data.y, dt_s=DT_S, inputs=("u",), outputs=data.outputs)
    found = only(outliers, spoilt, "outliers", "u")
    assert (found["count"], found["first_row"]) == (len(rows), rows[0])


@driven
def test_outliers___of_clean_records___are_none(drive: str) -> None:
    data = answer(DRIVES[drive](np.random.default_rng(22)), 22)
    assert not list(outliers(data))


def test_outliers___blows_that_the_outputs_answer___are_none() -> None:
    rng = np.random.default_rng(23)
    u = 1e-3 * rng.normal(size=(SAMPLES, 1))
    u[100::700] = 1.0
    b, a = [0.0, 1.0], [1.0, -1.9, 0.95]
    y = signal.lfilter(b, a, u, axis=0) + 1e-3 * rng.normal(size=u.shape)
    assert not list(outliers(IoData(u, y, dt_s=DT_S, outputs=("y",))))


@pytest.mark.parametrize("seed", range(3))
def test_input_and_output___of_exchanged_names___are_reported(seed: int) -> None:
    data = answer(DRIVES["white"](np.random.default_rng(seed)), seed)
    exchanged = IoData(data.y[:, 3:], data.u, dt_s=DT_S, inputs=("y",), outputs=("u",))
    (found,) = (each for each in answer_defects(exchanged) if "exchange" in each.text)
    assert (found.code, found.channel) == ("no_answer", "u")
    assert not any("exchange" in each.text for each in answer_defects(data))


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_counter___as_an_input___is_reported(jitter: float) -> None:
    data = answer(DRIVES["white"](np.random.default_rng(24)), 24)
    k = np.arange(SAMPLES) + jitter * np.random.default_rng(25).uniform(-1.0, 1.0, SAMPLES)
    counted = IoData(np.mod(5.0 * k, 25600.0), data.y, dt_s=DT_S, inputs=("n",))
    found = list(constant_channels(counted))
    assert [each.channel for each in found] == ["n"]
    assert not list(constant_channels(data))


def test_quantisation___steps_of_half_a_deviation___are_named_with_their_size() -> None:
    data = answer(DRIVES["white"](np.random.default_rng(13)), 13)
    y, step = data.y.copy(), 0.5 * data.y[:, 3].std()
    y[:, 3] = np.round(y[:, 3] / step) * step
    found = only(quantisation, IoData(data.u, y, dt_s=DT_S), "quantisation", "speed_v")
    assert found["step"] == pytest.approx(step)
    assert found["error"] == pytest.approx(0.5 / np.sqrt(12.0), rel=0.05)
    assert found["levels"] == len(np.unique(y[:, 3]))


def test_quantisation___fine_steps_and_a_filled_hole___are_no_defect() -> None:
    data = answer(DRIVES["white"](np.random.default_rng(14)), 14)
    step = 0.1 * data.y.std(axis=0)
    y = np.round(data.y / step) * step
    y[500:502] = np.nan
    assert not list(quantisation(IoData(data.u, y, dt_s=DT_S)))


def test_few_moves___one_step_in_a_long_record___is_counted() -> None:
    u = np.where(np.arange(30_000) < 9000, 0.0, 3.0)[:, np.newaxis]
    u += 0.005 * np.random.default_rng(15).normal(size=u.shape)
    found = only(drive_defects, answer(u, 15), "drive")
    assert found["moves"] == 1.0
    assert found["total_s"] == pytest.approx(100.0)
    assert found["active_s"] < 3.0


@driven
def test_held_drive___third_of_the_record___is_named_with_its_rows(drive: str) -> None:
    u = DRIVES[drive](np.random.default_rng(16)).copy()
    u[2000:4400] = u[2000]
    found = only(drive_defects, answer(u, 16), "drive")
    assert found["first_row"] == pytest.approx(2000, abs=200)
    assert found["last_row"] == pytest.approx(4400, abs=200)
    # Before it are more rows than behind it.
    (text,) = [str(each) for each in drive_defects(answer(u, 16))]
    assert (
        f"leave those rows out (--to {DT_S * found['first_row']:.9g}s), or excite throughout"
        in text
    )


@driven
@pytest.mark.parametrize("row", first_of([3000, 4200], 2))
def test_plant_changed___other_payload_in_mid_record___is_named_near_its_row(
    drive: str, row: int
) -> None:
    u = DRIVES[drive](np.random.default_rng(row))
    # The modes fall by a tenth.
    model = arm_model()
    A = np.array(model.A)
    for i in (3, 5, 7):
        pole = np.exp(0.9 * np.log(complex(A[i, i], A[i + 1, i])))
        A[i : i + 2, i : i + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    heavier = control.ss(A, model.B, model.C, model.D, DT_S)
    y = np.vstack([step_by_step(model, u)[:row], step_by_step(heavier, u)[row:]])
    measured = noisy(u, y, 17)
    found = only(changes, measured, "plant_changed")
    assert found["row"] == pytest.approx(row, abs=SAMPLES / 8)
    assert found["loss"] > 0.1
    (text,) = [str(each) for each in changes(measured)]
    percent, times = 100.0 * found["loss"], 1.0 + found["loss"]
    worse = f"{percent:.0f} % worse than" if times < 2.0 else f"{times:.0f} times as badly as"
    assert f"predicts the other {worse} its own" in text
    cut_s = f"{DT_S * found['row']:.9g}s"
    assert text.endswith(f"identify the parts separately (--to {cut_s}, --from {cut_s})")


def test_plant_changed___gauge_that_gives_noise_from_mid_record_on___names_the_sensor() -> None:
    data = answer(DRIVES["white"](np.random.default_rng(6)), 6)
    y, half = data.y.copy(), SAMPLES // 2
    y[half:, 2] = 0.01 * y[:, 2].std() * np.random.default_rng(7).normal(size=SAMPLES - half)
    (text,) = [str(each) for each in changes(replace(data, y=y))]
    assert "y2 hardly moves on one side: check the sensor, and leave that out (--to " in text


def integrating(seed: int) -> IoData:
    """Return an arm on a free hub, which drifts further on one side of a cut than on the other."""
    u = np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], SAMPLES // 4 + 1), 4)[:SAMPLES]
    hub, inertia, stiffness = 0.05, 0.03, 60.0
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    A[2] = np.array([-stiffness, stiffness, -0.07, 0.02]) / hub
    A[3] = np.array([stiffness, -stiffness, 0.02, -0.02]) / inertia
    C = np.array([[1.0, 0.0, 0.0, 0.0], [-1.0, 1.0, 0.0, 0.0]])
    plant = control.ss(A, [[0.0], [0.0], [20.0], [0.0]], C, 0.0).sample(DT_S)
    y = step_by_step(plant, u[:, np.newaxis])
    noise = np.random.default_rng(seed + 1).normal(size=y.shape)
    return IoData(u, y + 0.01 * y.std(axis=0) * noise, dt_s=DT_S, outputs=("hub", "bend"))


@pytest.mark.slow
def test_plant_changed___output_that_drifts___is_not_called_so() -> None:
    assert not [seed for seed in range(12) if list(changes(integrating(seed)))]


def test_plant_changed___sweep_of_a_steady_plant___is_not_called_so() -> None:
    times_s = np.arange(SAMPLES) * DT_S
    u = signal.chirp(times_s, 0.2, times_s[-1], 60.0)[:, np.newaxis]
    assert not list(changes(answer(u, 18)))


def controlled(factor: float, *, from_row: int) -> IoData:
    """Return a closed loop whose gains are multiplied from a row on, or whose drive is stopped."""
    model, rng = arm_model(), np.random.default_rng(19)
    reference = square_wave(SAMPLES, 19, (100, 400))
    x, u, y = np.zeros(model.nstates), np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 4))
    for k in range(SAMPLES):
        y[k] = model.C @ x + 0.01 * rng.normal(size=4)
        now = factor if k > from_row else 1.0
        u[k] = (reference[k] - now * np.array([[1.0, 0.0, 0.0, 0.3]]) @ y[k]) if now else 0.0
        x = model.A @ x + model.B @ u[k]
    return IoData(u, y, dt_s=DT_S, closed_loop=True, reference=reference[:, 0])


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_law_changed___other_gains_in_mid_record___are_information(factor: float) -> None:
    data = controlled(factor, from_row=SAMPLES // 2)
    found = [(each.code, str(each.grade)) for each in changes(data)]
    assert found == ([("plant_changed", "information")] if factor > 1.0 else [])


@pytest.mark.parametrize("share", [0.08, 0.3, 0.6])
def test_drive_that_was_stopped___is_called_so_and_no_change_of_the_law(share: float) -> None:
    row = round((1.0 - share) * SAMPLES)
    data = controlled(0.0, from_row=row)
    assert not list(changes(data))
    (stop,) = drive_defects(data)
    assert stop.figures["first_row"] == row + 1
    words = (
        r"the input is idle at zero from .* to the end, .* % of the record, as after a stop: leave"
    )
    assert re.match(words, stop.text)


@pytest.mark.parametrize("seed", range(4))
def test_record_checks___white_input_and_random_plant___say_nothing(seed: int) -> None:
    data = record(random_model(seed), 3000, seed, noise=0.1)
    checks = (answer_defects, outliers, quantisation, drive_defects, changes)
    assert not [found for check in checks for found in check(data)]
