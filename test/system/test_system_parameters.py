"""Parameters of live nodes: what is refused, and how it is said."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter

from support.exhaustive import first_of
from support.system_graph import PACKAGES, Graph

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return a graph whose nodes wait to be configured."""
    with Graph(tmp_path_factory.mktemp("running")) as graph:
        for name in ("daq", "controller", "recorder"):
            graph.start(name)
        yield graph


def values_of(graph: Graph, name: str, *parameters: str) -> list[object]:
    """Return parameters of a node."""
    response = graph.call(
        GetParameters, f"{name}/get_parameters", GetParameters.Request(names=parameters)
    )
    return [Parameter.from_parameter_msg(_named(value)).value for value in response.values]


def _named(value: Any) -> Any:  # noqa: ANN401 - messages
    message = Parameter("any", value=0).to_parameter_msg()
    message.value = value
    return message


@pytest.mark.parametrize(
    ("name", "parameters", "complaint"),
    first_of(
        [
            ("daq", {"rate_hz": 300}, "parameter rate_hz must be a float, such as 300.0"),
            ("controller", {"law": "lqr"}, "parameter law = 'lqr': must be one of pd, pi, pdp"),
            ("recorder", {"bag": "/dev/null"}, "parameter bag: /dev/null: exists already"),
            ("player", {}, "parameter bag is empty: name the bag, -p bag:=FOLDER"),
            ("ident", {"output_folder": 3}, "parameter output_folder must be a str"),
            ("daq", {"rate_hz": 5000.0}, "parameter rate_hz is out of its range, 10 to 2000 Hz"),
            ("daq", {"rig": "other"}, "rig 'other': no such file, and no packaged rig"),
            (
                "daq",
                {"time": "virtual", "rate_hz": 1000.0, "reply_delay_s": 0.002},
                "reply_delay_s must be from 0 to less than the period 0.001 s, got 0.002",
            ),
            (
                "controller",
                {"reference": "varying_square", "varying_square.shortest_s": 7.0},
                "shortest_s = 7 .*longest_s = 5",
            ),
            (
                "recorder",
                {"topics": ["state", "sound"]},
                "parameter topics = 'sound': must be one of commander",
            ),
            (
                "recorder",
                {"max_bagfile_size": 100},
                "parameter max_bagfile_size = 100: must be 0, or 65536 or more",
            ),
            ("player", {"bag": "/nowhere/bag"}, "parameter bag: /nowhere/bag: no such bag"),
        ],
        5,
    ),
)
def test_start___with_a_value_that_does_not_do___ends_with_one_line(
    graph: Graph, name: str, parameters: dict[str, object], complaint: str
) -> None:
    process = graph.start(name, parameters)
    code = process.exit_code()
    (line,) = process.printed.splitlines()
    assert re.search(complaint, line)
    assert code == 2


@pytest.mark.parametrize("name", first_of(sorted(PACKAGES, key="ident".__ne__)))
def test_parameter_that_a_node_does_not_have___is_refused_and_the_only_one_named(
    graph: Graph, name: str
) -> None:
    # The others are rclpy's own, and those of an identified model, whose file is for every node.
    given = {"use_sim_time": False, "models.arm.a": [0.5], "nonsense": 1}
    process = graph.start(name, given)
    assert process.exit_code() == 2
    (line,) = process.printed.splitlines()
    reported = "( .(nearest|known): [a-z_., ]+.)?"
    assert re.match(f"/flexarm/{name} has no parameter nonsense{reported}: ", line)


def test_misspelt_safety_limit_in_a_file___is_refused_with_the_nearest_name(
    graph: Graph, tmp_path: Path
) -> None:
    file = tmp_path / "limits.yaml"
    file.write_text("/**:\n  ros__parameters: {max_comand_v: 2.0, payload: 0.2}\n")
    process = graph.start("daq", {}, "--params-file", str(file))
    assert process.exit_code() == 2
    assert process.printed == (
        "/flexarm/daq has no parameter max_comand_v (nearest: max_command_v), "
        "payload (nearest: payload_kg): correct the name or leave it out\n"
    )


@pytest.mark.parametrize("word", first_of(["off", "on"]))
def test_word_of_which_yaml_has_made_a_boolean___is_the_word_again(
    graph: Graph, tmp_path: Path, word: str
) -> None:
    file = tmp_path / "rig.yaml"
    file.write_text(f"/**/daq: {{ros__parameters: {{self_test: {word}}}}}\n")
    graph.start("daq", {}, "--params-file", str(file))
    assert values_of(graph, "daq", "self_test") == [word]


def test_parameters_of_rclpy_and_of_models___are_taken(graph: Graph, tmp_path: Path) -> None:
    file = tmp_path / "all.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n    use_sim_time: false\n    models: {arm: {a: [0.5]}}\n"
        "    qos_overrides: {/parameter_events: {publisher: {depth: 100}}}\n"
    )
    process = graph.start("recorder", {}, "--params-file", str(file))
    assert values_of(graph, "recorder", "use_sim_time") == [False]
    assert graph.stop(process) == 0


@pytest.mark.parametrize(
    ("name", "parameter", "value", "complaint"),
    [
        ("daq", "payload_kg", 1.5, "Min: 0.0, Max: 1.0"),
        ("daq", "seed", -1, "Min: 0, Max: 2147483647"),
        ("daq", "noise", "loud", "noise = 'loud': must be one of low, thesis, none"),
        ("daq", "rate_hz", 100, "Wrong parameter type"),
        ("daq", "autostart", True, "read.only"),
        ("controller", "step.amplitude_v", 9.0, r"6\.857"),
        ("controller", "reference", "sawtooth", "must be one of topic, constant"),
        ("controller", "ilqr.states", [1.0, -1.0], "states = -1 is outside 0 to 1000"),
        ("controller", "trajectory", "/nowhere.csv", "law pd plays no trajectory; choose one"),
        ("recorder", "topics", ["sound"], "read.only"),
    ],
)
def test_running_node___refuses_a_value_with_what_it_may_be(
    running: Graph, name: str, parameter: str, value: object, complaint: str
) -> None:
    (before,) = values_of(running, name, parameter)
    request = SetParameters.Request(
        parameters=[Parameter(parameter, value=value).to_parameter_msg()]
    )

    (result,) = running.call(SetParameters, f"{name}/set_parameters", request).results

    assert not result.successful
    assert re.search(complaint, result.reason)
    assert values_of(running, name, parameter) == [before]


def test_parameters_that_belong_together___are_taken_or_refused_as_one_set(
    running: Graph,
) -> None:
    assert running.refusal("controller", {"reference": "varying_square"}) == ""
    names = ("law", "pdp.kp", "varying_square.shortest_s", "varying_square.longest_s")
    before = ["pd", pytest.approx(0.5935), 2.5, 5.0]

    assert "pdp.kp" in running.refusal("controller", {"law": "pdp", "pdp.kp": 99.0})
    assert values_of(running, "controller", *names) == before

    lonely = running.refusal("controller", {"varying_square.shortest_s": 6.0})
    assert re.search("shortest_s = 6 .*longest_s = 5", lonely)
    assert values_of(running, "controller", *names) == before

    pair = {"varying_square.shortest_s": 6.0, "varying_square.longest_s": 7.0}
    assert running.refusal("controller", pair | {"law": "pdp"}) == ""
    assert values_of(running, "controller", *names) == ["pdp", before[1], 6.0, 7.0]
