from __future__ import annotations

import re
import shutil
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python

from flexarm_daq import RigParameters
from flexarm_daq.rigs.beam import natural_frequencies_hz
from support.bag_samples import START_NS, Sent, arm_state, motor_command, reference, write_bag
from support.exhaustive import first_of
from support.identification_service import answered, as_plain, identify
from support.project import BAGS, SHARED
from support.system_graph import Graph, ros_arguments

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexarm_msgs.srv import Identify


pytestmark = pytest.mark.system

STEP_NS = 2_000_000
BAG = BAGS / "c_dat3_0g"
"""A closed-loop experiment of the simulated arm."""
QUANSER = SHARED / "data" / "quanser_2dsfl_fsf.csv"
ARM_OUTPUTS = ["position_v", "base_strain_v", "middle_strain_v", "speed_v"]


def reduced(graph: Graph, bag: Path, order: int) -> Identify.Response:
    """Identify a model of the arm as the demo does."""
    return identify(
        graph,
        bag,
        reduction="mrmc",
        reduced_order=order,
        known_modes_hz=natural_frequencies_hz(RigParameters()).tolist(),
        update="b",
        remove_compensation=True,
        stabilise=True,
    )


def got_from(graph: Graph, node: str, names: list[str]) -> dict[str, Any]:
    """Return parameters as the node tells them."""
    response = graph.call(
        GetParameters, f"{node}/get_parameters", GetParameters.Request(names=names)
    )
    values = [as_plain(parameter_value_to_python(value)) for value in response.values]
    return dict(zip(names, values, strict=True))


@pytest.fixture(scope="module")
def tenth_order(laboratory: Graph) -> Identify.Response:
    """Return what the service answers for the packaged experiment."""
    return reduced(laboratory, BAG, 10)


# Before a model of another order takes the place of these files.
def test_results___are_files_that_ros_reads_back(
    laboratory: Graph, tenth_order: Identify.Response
) -> None:
    folder = Path(tenth_order.report_path)
    parameters = answered(tenth_order)
    assert "<html" in (folder / "report.html").read_text().lower()

    node = rclpy.create_node(
        "reader",
        context=laboratory.context,
        cli_args=ros_arguments({}, "--params-file", str(folder / "model.yaml")),
        use_global_arguments=False,
        automatically_declare_parameters_from_overrides=True,
    )
    try:
        read = {
            f"models.{key}": as_plain(value.value)
            for key, value in node.get_parameters_by_prefix("models").items()
        }
    finally:
        node.destroy_node()
    assert read == parameters


# The three known modes take six states: of eight, two are left for the motion of the hub.
@pytest.mark.parametrize(("order", "largest_dmv"), first_of([(10, 0.45), (8, 0.6)]))
def test_closed_loop_bag___model_comes_as_parameters_and_is_set_on_the_node(
    laboratory: Graph, request: pytest.FixtureRequest, order: int, largest_dmv: float
) -> None:
    response: Identify.Response = (
        request.getfixturevalue("tenth_order") if order == 10 else reduced(laboratory, BAG, order)
    )

    assert response.success, response.message
    level, _, rest = response.message.partition(": ")
    assert level in {"good", "usable", "poor"}
    assert " Next: " in rest
    assert f". {BAG.name}: order " in rest
    assert "\n" not in response.message
    parameters = answered(response)
    sizes = {key: len(parameters[f"models.c_dat3_0g.{key}"]) for key in "abcd"}
    assert sizes == {"a": order * order, "b": order, "c": 4 * order, "d": 4}
    assert parameters["models.c_dat3_0g.states"] == order
    assert parameters["models.c_dat3_0g.dt_s"] == pytest.approx(1.0 / 300.0)
    assert parameters["models.c_dat3_0g.input_names"] == ["command_v"]
    assert parameters["models.c_dat3_0g.output_names"] == ARM_OUTPUTS
    assert got_from(laboratory, "ident", list(parameters)) == parameters
    kept = [mode for mode in response.modes if mode.kept]
    assert sum(1 + (mode.eigenvalue_imaginary > 0.0) for mode in kept) == order
    assert len(response.dmv) == len(response.left_out) == len(response.sfv) == 5
    for errors in (response.dmv, response.sfv):
        assert errors[-1] == pytest.approx(np.mean(errors[:-1]))
    assert response.dmv[-1] < largest_dmv
    found_hz = np.array([mode.frequency_hz for mode in kept])
    for true_hz in natural_frequencies_hz(RigParameters())[:2]:
        assert np.min(np.abs(found_hz / true_hz - 1.0)) <= 0.08


def arm_bag(path: Path, samples: int, *, volts: float = 1.0, bad_row: int | None = None) -> Path:
    """Write a bag of an arm that never was: random commands and their running means."""
    random = np.random.default_rng(3)
    command_v = volts * random.standard_normal(samples)
    filtered = np.convolve(command_v, [0.0, 0.4, 0.3, 0.2, 0.1])[:samples]
    messages: list[Sent] = [reference(START_NS, 1.0)]
    for k in range(samples):
        time_ns = START_NS + k * STEP_NS
        position_v = float("inf") if k == bad_row else filtered[k]
        outputs = (position_v, 0.5 * filtered[k], 0.1 * filtered[k], 2.0 * filtered[k])
        sequence = {"command_v": command_v[k], "command_sequence": k}
        messages += [
            arm_state(k + 1, time_ns, outputs, **sequence),
            motor_command(k + 1, time_ns + 400_000, command_v[k]),
        ]
    return write_bag(path, messages)


def missing(_: Path) -> Path:
    return Path("/nowhere/run")


def text_file(folder: Path) -> Path:
    path = folder / "notes.txt"
    path.write_text("no bag\n")
    return path


def text_as_mcap(folder: Path) -> Path:
    path = folder / "notes.mcap"
    path.write_text("no bag, whatever its name says\n")
    return path


def plain_folder(folder: Path) -> Path:
    path = folder / "plain"
    path.mkdir()
    return path


def cut_bag(folder: Path) -> Path:
    bag = arm_bag(folder / "cut", 500)
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-200])
    return bag


def bag_without_samples(folder: Path) -> Path:
    return write_bag(folder / "references", [reference(START_NS, 1.0)])


def short_bag(folder: Path) -> Path:
    return arm_bag(folder / "short", 60)


def constant_input(folder: Path) -> Path:
    return arm_bag(folder / "constant", 1200, volts=0.0)


def not_finite(folder: Path) -> Path:
    return arm_bag(folder / "inf", 1200, bad_row=300)


def good_bag(folder: Path) -> Path:
    return arm_bag(folder / "good", 1200)


@pytest.mark.parametrize(
    ("make_bag", "fields", "complaint"),
    [
        (missing, {}, "^/nowhere/run: no such bag$"),
        (text_file, {}, "notes.txt: say which of its columns is what"),
        (text_as_mcap, {}, "notes.mcap: truncated or damaged: .*flexarm bag repair"),
        (plain_folder, {}, "plain: no bag: the folder has no metadata.yaml"),
        (cut_bag, {}, "cut: truncated or damaged: .*flexarm bag repair"),
        (
            bag_without_samples,
            {},
            "references: holds neither ArmState nor IoSample; topics: /flexarm/reference",
        ),
        (
            short_bag,
            {"train_fraction": 0.5},
            "the leading 30 of 59 samples are too few, .*, or fit a longer part .train_fraction",
        ),
        (
            constant_input,
            {"train_fraction": 0.5},
            "command_v is constant in the leading 600 of 1199 samples, it exc",
        ),
        (not_finite, {}, "position_v is inf in row 300"),
        (good_bag, {"order": 25, "block_rows": 20}, "order must lie between 1 and 19 .*: 25"),
        (good_bag, {"block_rows": 1}, "block_rows must be 2 or more: 1"),
        (good_bag, {"method": "guess"}, "method must be one of auto, orse"),
        (good_bag, {"reduction": "some"}, "reduction must be one of none, mrm, msv, mrmc"),
        (good_bag, {"feedthrough": "maybe"}, "feedthrough must be one of auto, yes, no: 'maybe'"),
        (good_bag, {"bias": "median"}, "bias must be one of rest, first, mean, none: 'median'"),
        (
            good_bag,
            {"singular_value_threshold": 1.5},
            "singular_value_threshold is a part of the largest singular value, .*: 1.5",
        ),
        (good_bag, {"update": "d"}, "update must be one of none, b, c"),
        (good_bag, {"train_fraction": 1.5}, "train_fraction must lie between 0 and 1: 1.5"),
    ],
)
def test_wrong_input___is_refused_in_one_line(
    laboratory: Graph,
    tmp_path: Path,
    make_bag: Callable[[Path], Path],
    fields: dict[str, Any],
    complaint: str,
) -> None:
    response = identify(laboratory, make_bag(tmp_path), **fields)
    assert not response.success
    assert re.search(complaint, response.message)
    assert "\n" not in response.message
    assert not response.parameters
    assert not response.report_path


def test_no_bag_named___is_refused(laboratory: Graph) -> None:
    response = identify(laboratory)
    assert (response.success, response.message) == (
        False,
        "bag_uris is empty: name at least one bag",
    )


def test_model_file___is_taken_by_a_node_that_identifies_again(
    laboratory: Graph, tmp_path: Path
) -> None:
    bag = good_bag(tmp_path)
    first = identify(laboratory, bag, order=4, block_rows=20)
    with Graph(tmp_path) as graph:
        node = graph.start(
            "ident",
            {"output_folder": str(tmp_path / "models")},
            *("--params-file", str(Path(first.report_path) / "model.yaml")),
        )
        again = identify(graph, bag, order=4, block_rows=20)
        assert again.success, again.message
        assert again.dmv == pytest.approx(first.dmv, rel=1e-6)
        assert graph.stop(node, signal.SIGINT) == 0


def test_report_of_somebody_else___is_refused_by_name_and_stays(
    laboratory: Graph, tmp_path: Path
) -> None:
    bag = arm_bag(tmp_path / "mine", 1200)
    report = Path(identify(laboratory, bag, order=4, block_rows=20).report_path) / "report.html"
    report.write_text("mine")
    response = identify(laboratory, bag, order=4, block_rows=20)
    assert not response.success
    assert response.message.startswith(f"{report}: was not written by flexarm")
    assert report.read_text() == "mine"


def test_good_bag___is_what_the_wrong_ones_are_compared_with(
    laboratory: Graph, tmp_path: Path
) -> None:
    response = identify(laboratory, good_bag(tmp_path), order=4, block_rows=20)
    assert response.success, response.message


def test_bag_named_by_uri_and_as_single_file___is_the_same_bag(
    laboratory: Graph, tmp_path: Path
) -> None:
    bag = good_bag(tmp_path)
    (file,) = bag.glob("*.mcap")
    shutil.copy(file, tmp_path / "good.mcap")
    plain, by_uri, single = (
        answered(identify(laboratory, name, order=4, block_rows=20))
        for name in (bag, bag.as_uri(), tmp_path / "good.mcap")
    )
    for same in (by_uri, single):
        assert list(same["models.good.a"]) == pytest.approx(list(plain["models.good.a"]), abs=1e-9)
