from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from support.system_graph import ROOT

if TYPE_CHECKING:
    from support.system_graph import Graph

pytestmark = pytest.mark.system


@pytest.mark.exhaustive
def test_status___shows_what_each_node_reports(graph: Graph) -> None:
    graph.start("recorder")
    graph.start("controller", {"law": "pd"})
    graph.start("daq", {"rate_hz": 100.0})
    graph.activate_loop()
    assert graph.transition("daq", "activate")
    wanted = (
        "^recorder: not recording$",
        r"^controller: active$\n    law +pd$",
        r"^daq: active$\n    drive +driving$",
    )

    def shows_all() -> bool:
        process = graph.run([str(ROOT / "flexarm"), "status"])
        process.exit_code()
        return all(re.search(line, process.printed, re.MULTILINE) for line in wanted)

    # On a busy machine discovery may miss a node for longer than the verb waits.
    graph.wait(shows_all, "\n".join(wanted))


def test_status___without_a_graph___says_so(graph: Graph) -> None:
    process = graph.run([str(ROOT / "flexarm"), "status"])
    assert process.exit_code() == 1
    assert process.printed == (
        f"flexarm: no node that reports was found in ROS domain {graph.domain} within 4 s: "
        "start an arm with flexarm up, or use its ROS_DOMAIN_ID and --namespace\n"
    )


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        pytest.param(["status"], "node that reports", marks=pytest.mark.exhaustive),
        (["reference", "1"], "node /flexarm/controller"),
    ],
)
def test_verb___for_an_arm_that_is_not_there___names_those_that_are(
    graph: Graph, words: list[str], wanted: str
) -> None:
    graph.start("recorder", {}, "-r", "__ns:=/arm2")
    graph.wait(lambda: "/arm2/recorder" in graph.operator.nodes(), "the other arm")
    process = graph.run([str(ROOT / "flexarm"), *words])
    assert process.exit_code() == 1
    assert process.printed == (
        f"flexarm: no {wanted} was found in ROS domain {graph.domain} within 4 s in "
        "/flexarm, but /arm2 was: give --namespace arm2\n"
    )


@pytest.mark.parametrize("verb", ["activate", "deactivate"])
def test_node_without_a_lifecycle___is_refused_before_any_search(verb: str) -> None:
    done = CliRunner().invoke(main, [verb, "ident"])
    assert done.exit_code == 1
    assert done.output == (
        "flexarm: ident has no lifecycle: daq, controller, experiment have one\n"
    )


def test_verbs___operate_a_running_graph(graph: Graph) -> None:
    def flexarm(*arguments: str) -> tuple[int, str]:
        process = graph.run([str(ROOT / "flexarm"), *arguments])
        return process.exit_code(), process.printed.splitlines()[-1]

    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.NEWEST)
    graph.start("controller", {"law": "pd", "pd.compensation_v": 0.9})
    graph.start("daq", {"rate_hz": 100.0})
    # A verb waits for the discovery of a node, not for its start.
    for name in ("controller", "daq"):
        assert graph.state_of(name) == "unconfigured"

    motion = "to its set-point"
    driven = f"; while both are, the controller drives the arm {motion}"
    assert flexarm("activate", "daq") == (0, f"daq is active{driven}")
    assert flexarm("deactivate", "controller") == (
        1,
        "flexarm: controller is not active but unconfigured",
    )
    assert flexarm("activate", "/flexarm/controller") == (0, f"controller is active{driven}")
    assert flexarm("reference", "-1.5") == (0, "set-point -1.5 V")
    graph.wait(lambda: bool(states) and states[-1].position_v < -1.0, "the motion")

    code, said = flexarm("set", "controller", "pd.kp=2", "pd.kd=900")
    assert code == 1
    assert said.startswith("flexarm: controller refused: ")
    assert flexarm("set", "controller", "pd.kp=2e0") == (0, "controller pd.kp: 1.0 -> 2.0")
    assert flexarm("set", "controller", "pd.kp=2", "pd.kq=2") == (
        1,
        "flexarm: controller has no parameter pd.kq (nearest: pd.kp)",
    )

    code, said = flexarm("stop")
    assert code == 0
    assert said.startswith("Then: ")
    assert said.endswith("flexarm activate daq")
    assert flexarm("activate", "daq") == (
        1,
        "flexarm: daq is active already; what holds it ends with: deactivate daq",
    )
    graph.wait(lambda: states[-1].command_v == 0.0, "the drive at zero")
    later = f"; once active again, an active controller drives the arm {motion}, at once"
    assert flexarm("deactivate", "daq") == (0, f"daq is inactive{later}")
    code, said = flexarm("reference", "200deg")
    assert code == 2
    assert said.endswith("200 deg is not in the range -80 to 80 deg.")
    code, said = flexarm("reference", "far")
    assert code == 2
    assert "'far' is not a number" in said
    assert all(unit in said for unit in ("V", "mV", "deg", "rad"))
