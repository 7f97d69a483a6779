from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

from flexarm_bringup.graph.processes import LaunchError
from flexarm_msgs.msg import ArmState, MotorCommand
from flexarm_msgs.srv import Identify, SetReference
from flexarm_node import qos
from support.exhaustive import first_of
from support.project import BAGS
from support.recorded_samples import States
from support.system_graph import Graph

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rclpy.task import Future

    from support.system_graph import Process

pytestmark = pytest.mark.system

MAX_AGE_PERIODS = 3
"""Default age of a command from which the DAQ node sets the drive to zero."""
# A step whose error stays, so that the command never is zero by itself.
RESTLESS = {"law": "pd", "reference": "square", "square.period_s": 0.4, "pd.compensation_v": 0.7}

DRIVEN: dict[str, object] = {
    "rate_hz": 300.0,
    "real_time_factor": 1.0,
    "samples": 0,
    "max_command_v": 10.0,
    "position_bound_v": 6.5,
}


def nothing(_: int) -> None:
    """Show no progress."""


def start_loop(
    graph: Graph,
    daq: dict[str, object],
    controller: dict[str, object] | None = None,
    *,
    recorder: bool = True,
) -> Process:
    """Start recorder, controller and daq, up to the sampling itself; return the controller."""
    if recorder:
        graph.start("recorder")
    process = graph.start("controller", controller or RESTLESS)
    graph.start("daq", daq)
    graph.activate_loop()
    return process


def record(graph: Graph, bag: Path, samples: int) -> States:
    """Sample and record; return what is in the bag."""
    graph.operator.record(str(bag))
    graph.operator.sample(samples, nothing)
    graph.operator.record(None)
    return States(bag)


@pytest.fixture(scope="module")
def shared_loop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return a loop that waits to be activated, with a restless controller."""
    with Graph(tmp_path_factory.mktemp("shared")) as graph:
        start_loop(graph, DRIVEN)
        yield graph


@pytest.fixture
def driven_loop(shared_loop: Graph) -> Graph:
    """Return it at 300 Hz and at the pace of the clock."""
    shared_loop.operator.set_parameters("daq", DRIVEN)
    return shared_loop


@pytest.fixture
def virtual_loop(driven_loop: Graph) -> Graph:
    """Return it as fast as it goes."""
    driven_loop.operator.set_parameters("daq", {"real_time_factor": 0.0})
    return driven_loop


def test_virtual_time___same_seed_same_numbers___other_seed_others(
    virtual_loop: Graph, tmp_path: Path
) -> None:
    def run(seed: int, name: str) -> States:
        virtual_loop.operator.set_parameters("daq", {"seed": seed})
        return record(virtual_loop, tmp_path / name, 600)

    first, again, other = run(7, "first"), run(7, "again"), run(8, "other")

    for states in (first, again, other):
        np.testing.assert_array_equal(states.sequence, np.arange(1, 601))
        # Every sample was answered: each one carries the answer to the one before.
        assert states.command_sequence[0] == 0
        assert np.all(np.diff(states.command_sequence[1:]) == 1)
    np.testing.assert_array_equal(first.volts, again.volts)
    assert np.any(first.command_v != 0.0)
    assert np.mean(first.volts[:, :4] != other.volts[:, :4]) > 0.5


def test_command_beyond_the_limits___is_recorded_as_limited(
    virtual_loop: Graph, tmp_path: Path
) -> None:
    virtual_loop.operator.set_parameters("daq", {"max_command_v": 0.5})
    run = record(virtual_loop, tmp_path / "run", 600)
    assert np.abs(run.command_v).max() == 0.5


def test_limits_set_while_driving___act_at_once___and_the_rate_is_refused(
    driven_loop: Graph,
) -> None:
    graph = driven_loop
    states: list[ArmState] = []
    heard = graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    assert graph.transition("daq", "activate")
    graph.wait(lambda: any(abs(state.command_v) > 0.7 for state in states), "a strong command")

    graph.operator.set_parameters("daq", {"max_command_v": 0.5, "position_bound_v": 6.0})
    states.clear()
    graph.wait(lambda: len(states) >= 400, "samples with the new limit")

    # What was on its way when the limit was set may come first.
    assert max(abs(state.command_v) for state in states[200:]) == 0.5
    with pytest.raises(LaunchError, match=r"refused: rate_hz: deactivate the node first"):
        graph.operator.set_parameters("daq", {"rate_hz": 500.0, "max_command_v": 10.0})
    assert graph.transition("daq", "deactivate")
    graph.operator.set_parameters("daq", {"rate_hz": 500.0, "max_command_v": 10.0})
    graph.node.destroy_subscription(heard)


def test_first_activation___stamps_are_the_instants_of_sampling(graph: Graph) -> None:
    ages_s: list[float] = []

    def heard(state: ArmState) -> None:
        stamp = state.header.stamp
        ages_s.append(time.time() - stamp.sec - 1e-9 * stamp.nanosec)

    graph.node.create_subscription(ArmState, "state", heard, qos.EVERY)
    # Virtual time falls behind the wall clock where the machine stalls.
    graph.start("daq", {"autostart": True, "rate_hz": 100.0, "time": "real"})
    graph.wait(lambda: len(ages_s) >= 200, "samples")
    # A busy machine makes samples arrive late; none arrives before it was taken, but the wall clock
    # may be slewed meanwhile, and the node be interrupted between the two clocks that it compares.
    assert -0.01 < min(ages_s) < 0.05


@pytest.mark.parametrize(
    ("law", "advice"),
    first_of(
        [
            ("ilqr", "sample at that rate or take another law"),
            ("pdpc_plus", "set pdpc_plus.rate_hz"),
        ]
    ),
)
def test_law_for_another_rate___controller_ends_and_the_drive_is_at_zero(
    graph: Graph, law: str, advice: str
) -> None:
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    controller = start_loop(
        graph,
        {"real_time_factor": 0.0, "rate_hz": 500.0, "answer_timeout_s": 0.05},
        {"law": law, "reference": "square", "square.period_s": 0.4},
        recorder=False,
    )
    assert graph.transition("daq", "activate")
    controller.wait_for(f"law {law} is made for 300 Hz and the samples come at 500 Hz: {advice}")
    graph.wait(
        lambda: bool(states) and states[-1].sequence >= 75 and states[-1].command_v == 0.0,
        "samples at zero after that",
    )
    set_point = SetReference.Request(reference_v=0.5)
    # It says why it ends before it has ended.
    graph.wait(
        lambda: graph.refusal("controller", {"reference": "topic"}) == "",
        "parameters that are taken, as no sample is answered",
    )
    answer = graph.call(SetReference, "set_reference", set_point)
    assert not answer.success
    assert answer.message.startswith(
        "reference 0.5 V refused: the controller is not active, the loop has ended: law "
    )
    assert answer.message.endswith(f"{advice}; then activate controller")


def test_law_for_another_rate___is_refused_while_samples_come(virtual_loop: Graph) -> None:
    graph = virtual_loop
    states: list[ArmState] = []
    heard = graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    graph.operator.set_parameters("daq", {"rate_hz": 500.0})
    assert graph.transition("daq", "activate")
    graph.wait(lambda: bool(states) and states[-1].sequence > 200, "a measured rate")
    assert graph.refusal("controller", {"law": "ilqr"}) == (
        "law ilqr is made for 300 Hz and the samples come at 500 Hz: "
        "sample at that rate or take another law"
    )
    assert graph.refusal("controller", {"law": "pdp"}) == ""
    assert graph.refusal("controller", {"law": "pd"}) == ""
    assert graph.transition("daq", "deactivate")
    graph.node.destroy_subscription(heard)


def test_killed_controller___drive_goes_to_zero_and_stays(graph: Graph, tmp_path: Path) -> None:
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    warnings: list[str] = []
    graph.node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: warnings.extend(
            each.message for each in message.status if "no command in time since" in each.message
        ),
        qos.EVERY,
    )
    controller = start_loop(graph, {"rate_hz": 300.0})
    graph.operator.record(str(tmp_path / "run"))
    assert graph.transition("daq", "activate")
    graph.wait(lambda: len(states) >= 150 and states[-1].command_v != 0.0, "a driven arm")

    assert graph.stop(controller, signal.SIGKILL) == -signal.SIGKILL
    graph.wait(lambda: bool(warnings), "a warning")
    graph.wait(lambda: len(states) >= 400, "samples without a controller")
    assert graph.transition("daq", "deactivate")
    graph.operator.record(None)

    run = States(tmp_path / "run")
    last = run.command_sequence.max()
    in_force = np.flatnonzero(run.command_sequence == last)
    assert 1 <= len(in_force) <= MAX_AGE_PERIODS + 1
    assert np.any(run.command_v[in_force] != 0.0)
    after = slice(in_force[-1] + 1, None)
    assert len(run.command_v[after]) >= 100
    assert not np.any(run.command_v[after])
    assert not np.any(run.command_sequence[after])


def test_emergency_stop___holds_zero_until_the_node_is_activated_again(
    driven_loop: Graph,
) -> None:
    graph = driven_loop
    states: list[ArmState] = []
    heard = graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)

    def emergency_stop() -> Trigger.Response:
        response: Trigger.Response = graph.call(Trigger, "emergency_stop", Trigger.Request())
        return response

    assert emergency_stop().message == "not active: the drive is at zero"

    assert graph.transition("daq", "activate")
    graph.wait(lambda: len(states) >= 60 and states[-1].command_v != 0.0, "a driven arm")
    answer = emergency_stop()
    assert answer.success
    assert answer.message == "the drive is held at zero until the node is deactivated"
    # What was on its way when the stop was asked for still shows the command.
    states.clear()
    graph.wait(lambda: len(states) >= 400, "samples after the stop")
    assert not any(state.command_v for state in states[200:])

    assert graph.transition("daq", "deactivate")
    states.clear()
    assert graph.transition("daq", "activate")
    graph.wait(lambda: any(state.command_v != 0.0 for state in states), "a driven arm again")
    assert graph.transition("daq", "deactivate")
    graph.node.destroy_subscription(heard)


def test_emergency_stop___is_reported_at_once(driven_loop: Graph) -> None:
    graph = driven_loop
    reports: list[str] = []
    graph.node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda message: reports.extend(
            each.message for each in message.status if each.name.endswith("/daq")
        ),
        qos.EVERY,
    )

    def reports_within_half_a_second() -> bool:
        """Return whether a stop right behind a report shows long before the next one is due."""
        assert graph.transition("daq", "activate")
        reports.clear()
        graph.wait(lambda: "active" in reports, "a report")
        heard_s = time.monotonic()
        assert graph.call(Trigger, "emergency_stop", Trigger.Request()).success
        graph.wait(lambda: reports[-1].startswith("active: the drive is held"), "the report")
        passed_s = time.monotonic() - heard_s
        assert graph.transition("daq", "deactivate")
        return passed_s < 0.5

    assert any(reports_within_half_a_second() for _ in range(20))


@pytest.mark.exhaustive
def test_real_time___500_hz_while_a_model_is_identified___records_every_sample(
    graph: Graph, tmp_path: Path
) -> None:
    """A busy machine may skip periods: then their numbers are missing, and no others."""
    graph.start("ident", {"output_folder": str(tmp_path / "models")})
    start_loop(
        graph,
        {"time": "real", "rate_hz": 500.0},
        {"law": "pd", "pd.compensation_v": 0.7, "reference": "varying_square"},
    )
    request = Identify.Request(bag_uris=[str(BAGS / "c_dat3_0g")], remove_compensation=True)
    identify = graph.node.create_client(Identify, "identify")
    graph.wait(identify.service_is_ready, "the identification service")
    graph.operator.acquaint("ident")
    answers: list[Future] = []

    def keep_identifying(_: int) -> None:
        if not answers or answers[-1].done():
            answers.append(identify.call_async(request))

    graph.operator.record(str(tmp_path / "run"))
    sampled = graph.operator.sample(1000, keep_identifying)
    graph.operator.record(None)

    run = States(tmp_path / "run")
    assert len(run.sequence) == sampled.taken
    assert run.sequence[-1] == sampled.taken + sampled.missed >= 1000
    late = run.stamp_s * 500.0 - run.sequence
    # Each sample was taken in the period of its number, but for an interruption on the way to it:
    # to any of them, the first one included.
    assert np.mean(late - late.min() < 1.1) > 0.99
    graph.wait(answers[-1].done, "the last model")
    results = [answer.result() for answer in answers]
    assert all(result.success for result in results), results[0].message


def test_virtual_time___controller_activated_after_the_first_sample___answers_it(
    virtual_loop: Graph,
) -> None:
    graph = virtual_loop
    heard: list[MotorCommand] = []
    graph.node.create_subscription(MotorCommand, "/flexarm/command", heard.append, qos.EVERY)
    sampled: list[ArmState] = []
    graph.node.create_subscription(ArmState, "/flexarm/state", sampled.append, qos.EVERY)
    graph.operator.set_parameters("daq", {"answer_timeout_s": 60.0, "samples": 20})
    assert graph.transition("controller", "deactivate")
    assert graph.transition("daq", "activate")
    graph.wait(lambda: bool(sampled), "the first sample")

    assert graph.transition("controller", "activate")

    graph.wait(lambda: len(sampled) == 20 and len(heard) >= 19, "all samples")
    assert heard[0].state_sequence == 1
