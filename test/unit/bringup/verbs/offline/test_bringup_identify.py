"""The verbs identify and report on bags that other programs recorded, in this process."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from rosbags.rosbag2 import StoragePlugin

from flexarm_bringup.verbs.offline.identify import identify, report
from flexarm_core.errors import BagError, DataError
from flexarm_ident import IoData, load_model, read_channels, selection
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run as identified
from support.exhaustive import first_of
from support.foreign_bags import (
    DAMPING,
    FINE_HZ,
    MODES_HZ,
    Topic,
    float64,
    float64_arrays,
    held_noise,
    instants_ns,
    joint_states,
    responses,
    wrenches,
    write_topics,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import control

    from support.foreign_bags import Array, Integers

    Made = tuple[list[Topic], StoragePlugin, list[str]]

DURATION_S = 30
FINE = DURATION_S * FINE_HZ
STEP = FINE_HZ // 200
"""Instants of the fine grid from one sample at 200 Hz to the next."""
EVERY = np.arange(0, FINE, STEP)


def noisy(values: Array, seed: int) -> Array:
    """Return measured values: noise of 0.5 % is added."""
    noise = np.random.default_rng(seed).normal(size=values.shape)
    return np.asarray(values + 0.005 * values.std() * noise)


def driven(changes: Integers, seed: int) -> tuple[Array, Array]:
    """Return force, position and strain on the fine grid; the last two as columns."""
    force = held_noise(changes, FINE, seed)
    return force, responses(force)


def joint_states_alone() -> Made:
    force, outputs = driven(EVERY, 1)
    still = np.zeros(len(EVERY))
    states = joint_states(
        instants_ns(EVERY),
        ["gripper", "arm"],
        np.column_stack([still, noisy(outputs[EVERY, 0], 2)]),
        efforts=np.column_stack([still, force[EVERY]]),
    )
    words = ["--input", "/joint_states.effort[arm]", "--output", "/joint_states.position[arm]"]
    return [states], StoragePlugin.MCAP, words


def command_without_header() -> Made:
    # Each command comes a third of a period after its sample, and acts at once.
    sent = EVERY + STEP // 3
    force, outputs = driven(sent, 3)
    command = float64("/command", instants_ns(sent), force[sent])
    angle = float64("/angle", instants_ns(EVERY), noisy(outputs[EVERY, 0], 4))
    words = ["--input", "drive_v=/command.data", "--output", "angle_v=/angle.data"]
    return [command, angle], StoragePlugin.SQLITE3, words


def motor_array_and_arrivals_with_jitter() -> Made:
    force, outputs = driven(EVERY, 5)
    delays_ns = np.random.default_rng(6).gamma(2.0, 1e6, (2, len(EVERY))).astype(np.int64)
    sent_ns, stated_ns = (np.sort(instants_ns(EVERY) + each) for each in delays_ns)
    commands = float64_arrays("/efforts", sent_ns, np.outer(force[EVERY], [0.0, 1.0]))
    gauge = float64_arrays("/gauges", stated_ns, noisy(outputs[EVERY], 7))
    words = ["--input", "/efforts.data[1]"]
    for element in (0, 1):
        words += ["--output", f"/gauges.data[{element}]"]
    return [commands, gauge], StoragePlugin.MCAP, words


def measured_force_of_another_rate() -> Made:
    # The force changes every 2 ms, and is sensed at 1 kHz, off the instants of the states.
    changes = np.arange(0, FINE, FINE_HZ // 500)
    force, outputs = driven(changes, 8)
    felt = np.arange(3, FINE, FINE_HZ // 1000)
    sensor = wrenches("/ft", instants_ns(felt), force[felt])
    states = joint_states(instants_ns(EVERY), ["arm"], noisy(outputs[EVERY, :1], 9))
    words = ["--input", "/ft.wrench.force.x", "--output", "/joint_states.position[0]"]
    return [sensor, states], StoragePlugin.SQLITE3, words


def outputs_of_two_rates() -> Made:
    force, outputs = driven(EVERY, 10)
    slow = np.arange(17, FINE, FINE_HZ // 120)
    states = joint_states(
        instants_ns(EVERY),
        ["arm"],
        noisy(outputs[EVERY, :1], 11),
        efforts=force[EVERY, np.newaxis],
    )
    # Received late: the headers count.
    late_ns = instants_ns(slow) + 30_000_000
    sensor = wrenches("/ft", instants_ns(slow), noisy(outputs[slow, 1], 12), received_ns=late_ns)
    words = ["--input", "/joint_states.effort[arm]", "--output", "/joint_states.position[arm]"]
    return [states, sensor], StoragePlugin.MCAP, [*words, "--output", "/ft.wrench.force.x"]


def nearest_mode(model: control.StateSpace, hz: float) -> tuple[float, float]:
    """Return frequency and damping of the vibrating mode that is nearest to a frequency."""
    poles = np.log(np.linalg.eigvals(model.A).astype(complex)) / model.dt
    poles = poles[poles.imag > 0.0]
    nearest = poles[np.argmin(np.abs(np.abs(poles) / (2.0 * np.pi) - hz))]
    return float(np.abs(nearest)) / (2.0 * np.pi), float(-nearest.real / np.abs(nearest))


def run(words: Sequence[str]) -> str:
    """Run identify as a user does."""
    done = CliRunner().invoke(identify, list(words), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.slow
@pytest.mark.parametrize(
    "make",
    first_of(
        [
            joint_states_alone,
            command_without_header,
            motor_array_and_arrivals_with_jitter,
            measured_force_of_another_rate,
            outputs_of_two_rates,
        ],
        2,
    ),
)
def test_identify___foreign_bag___one_command_finds_the_modes(
    tmp_path: Path, make: Callable[[], Made]
) -> None:
    topics, storage, words = make()
    bag = write_topics(tmp_path / "run", topics, storage)

    run([str(bag), "-o", str(tmp_path / "out"), *words])

    model = load_model(tmp_path / "out" / "model.yaml")
    for hz, damping in zip(MODES_HZ, DAMPING, strict=True):
        found_hz, found_damping = nearest_mode(model, hz)
        assert found_hz == pytest.approx(hz, rel=0.005)
        assert found_damping == pytest.approx(damping, abs=0.004)
    assert (tmp_path / "out" / "report.html").is_file()


def test_identify___wrong_field___is_one_line_and_writes_nothing(tmp_path: Path) -> None:
    topics, storage, words = joint_states_alone()
    bag = write_topics(tmp_path / "run", topics, storage)
    words[1] = "/joint_states.torque[arm]"
    with pytest.raises(BagError, match=r"no number torque\[arm\] \(did you mean effort\[arm\]"):
        run([str(bag), "-o", str(tmp_path / "out"), *words])
    assert not (tmp_path / "out").exists()


QUICK = ("--order", "4", "--method", "orse", "--no-friction")


def test_identify___part_of_a_bag___model_is_that_of_its_rows(tmp_path: Path) -> None:
    topics, storage, words = joint_states_alone()
    bag = write_topics(tmp_path / "run", topics, storage)

    run([str(bag), "-o", str(tmp_path / "out"), *words, *QUICK, "--from", "5s", "--to", "0.2min"])

    data = read_channels(bag, selection([words[1]], [words[3]]))
    part = IoData(
        data.u[1000:2400], data.y[1000:2400], dt_s=0.005, inputs=data.inputs, outputs=data.outputs
    )
    expected = identified([part], Request(order=4, method="orse", friction=False)).model
    np.testing.assert_array_equal(load_model(tmp_path / "out" / "model.yaml").A, expected.A)


def test_identify___part_behind_the_end___is_one_line_and_writes_nothing(tmp_path: Path) -> None:
    topics, storage, words = joint_states_alone()
    bag = write_topics(tmp_path / "run", topics, storage)
    with pytest.raises(DataError, match="run: --from 31 s is behind its end at 30 s"):
        run([str(bag), "-o", str(tmp_path / "out"), *words, "--from", "31"])
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_identify_each___one_bag_is_missing___the_others_have_models(tmp_path: Path) -> None:
    topics, storage, words = joint_states_alone()
    bag, out = write_topics(tmp_path / "run", topics, storage), tmp_path / "out"
    quick = [*QUICK, "--jobs", "1"]
    missing = tmp_path / "none"
    done = CliRunner().invoke(
        identify, ["--each", str(bag), str(missing), "-o", str(out), *words, *quick]
    )
    assert done.exit_code == 1, done.output
    assert (out / "models.csv").is_file()
    assert len(list(out.glob("*/model.yaml"))) == 1


def test_identify___jobs_without_each___are_refused(tmp_path: Path) -> None:
    refused = CliRunner().invoke(identify, [str(tmp_path), "--jobs", "2"])
    assert refused.exit_code == 2
    assert "--jobs, --dask and --parquet belong to --each" in refused.output


def test_identify___clock_without_channels___is_refused(tmp_path: Path) -> None:
    refused = CliRunner().invoke(identify, [str(tmp_path), "--clock", "header"])
    assert refused.exit_code == 2
    assert "belong to --input and --output" in refused.output


def test_report___file_without_suffix___is_refused_with_the_name_to_give(tmp_path: Path) -> None:
    refused = CliRunner().invoke(report, [str(tmp_path), "-o", str(tmp_path / "arm")])
    assert refused.exit_code == 2
    assert f"the report is one page: {tmp_path / 'arm.html'}" in refused.output


@pytest.mark.parametrize("display", ["", ":0"])
def test_report_open___of_a_comparison___opens_its_file_where_there_is_a_display(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, display: str
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(
        "flexarm_ident.series.comparison.compare_files", lambda *_, **__: ("two models",)
    )
    page = tmp_path / "both.html"
    said = CliRunner().invoke(report, ["a", "b", "--open", "-o", str(page)])
    assert said.exit_code == 0, said.output
    assert opened == ([page.as_uri()] if display else [])


def test_identify___into_a_bag___is_refused_before_the_work(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    bag.mkdir()
    (bag / "metadata.yaml").touch()
    done = CliRunner().invoke(identify, [str(bag), "-o", str(bag)])
    assert f"-o {bag} is a bag: name a folder of its own" in done.output
    assert done.exit_code == 2
