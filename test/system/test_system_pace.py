"""Virtual time at a pace: the machine may stall, the samples stay the same."""

from __future__ import annotations

import os
import signal
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from flexarm_bags.check import check_bag
from flexarm_bringup.graph.processes import LaunchError
from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from flexarm_node.stamps import stamp_ns
from support.exhaustive import first_of
from support.recorded_samples import States, declarations
from support.system_graph import Graph

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from flexarm_bringup.graph.figures import Run

pytestmark = pytest.mark.system

LAW = {"law": "pdpc", "reference": "square", "square.period_s": 1.0}
LONGEST_TIMEOUT_S = 60.0


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return a loop at the default pace, ready to sample."""
    with Graph(tmp_path_factory.mktemp("pace")) as graph:
        graph.start("recorder")
        graph.start("controller", LAW)
        # An answer that is only late shall never look like one that does not come.
        graph.start("daq", {"answer_timeout_s": LONGEST_TIMEOUT_S})
        graph.configure_loop()
        graph.operator.await_recorder()
        yield graph


def recorded(
    graph: Graph,
    bag: Path,
    samples: int,
    progress: Callable[[int], None] = lambda _: None,
    *,
    factor: float = 1.0,
) -> tuple[Run, States]:
    """Record one run at a pace."""
    graph.operator.set_parameters("daq", {"real_time_factor": factor, "seed": 4})
    run = graph.operator.recorded_run("controller", str(bag), samples, progress)
    return run, States(bag)


@pytest.mark.parametrize("factor", first_of([20.0, 1.0, 0.5]))
def test_any_pace___gives_the_samples_of_the_fastest(
    loop: Graph, tmp_path: Path, factor: float
) -> None:
    _, fastest = recorded(loop, tmp_path / "fastest", 450, factor=0.0)

    run, paced = recorded(loop, tmp_path / "paced", 450, factor=factor)

    np.testing.assert_array_equal(paced.sequence, np.arange(1, 451))
    np.testing.assert_array_equal(paced.volts, fastest.volts)
    np.testing.assert_array_equal(paced.command_sequence[1:] > 0, np.ones(449, dtype=bool))
    assert (run.taken, run.missed) == (450, 0)
    # A busy machine is slower; none is faster.
    assert 0.0 < run.real_time_factor < 1.01 * factor
    assert check_bag(tmp_path / "paced").problems == ()


def test_page_that_looks_on___changes_no_sample(loop: Graph, tmp_path: Path) -> None:
    _, alone = recorded(loop, tmp_path / "alone", 450, factor=0.0)
    readers = loop.node.count_subscribers("state")
    page = loop.start("live", {"view_only": True})
    try:
        loop.wait(lambda: loop.node.count_subscribers("state") > readers, "the page's reader")
        _, watched = recorded(loop, tmp_path / "watched", 450, factor=0.0)
    finally:
        loop.stop(page)
    np.testing.assert_array_equal(watched.volts, alone.volts)


def test_nodes_that_are_stopped_at_random___lose_nothing_and_change_no_sample(
    loop: Graph, tmp_path: Path
) -> None:
    random = np.random.default_rng(11)
    nodes = [
        pid
        for name in ("recorder_node", "controller_node", "daq_node")
        for pid in loop.survivors(name)
    ]
    assert len(nodes) == 3
    stopped: list[int] = []

    def stop_one(_: int) -> None:
        if random.random() < 0.2:
            pid = int(random.choice(nodes))
            stopped.append(pid)
            os.kill(pid, signal.SIGSTOP)
            # The length of the stop, which is the fault, and no deadline.
            time.sleep(random.uniform(0.02, 0.25))
            os.kill(pid, signal.SIGCONT)

    _, undisturbed = recorded(loop, tmp_path / "undisturbed", 900, factor=0.0)
    run, disturbed = recorded(loop, tmp_path / "disturbed", 900, stop_one)

    assert set(stopped) == set(nodes)
    assert (run.taken, run.missed) == (900, 0)
    assert run.real_time_factor < 1.0
    np.testing.assert_array_equal(disturbed.sequence, np.arange(1, 901))
    np.testing.assert_array_equal(disturbed.volts, undisturbed.volts)
    assert check_bag(tmp_path / "disturbed").problems == ()


def test_who_commands___is_in_every_bag___also_in_one_that_is_begun_later(
    loop: Graph, tmp_path: Path
) -> None:
    operator = loop.operator
    states: list[ArmState] = []
    heard = loop.node.create_subscription(ArmState, "state", states.append, qos.NEWEST)
    operator.record(str(tmp_path / "first"))
    operator.activate("controller")
    operator.start_sampling()
    loop.wait(lambda: len(states) > 50, "samples")
    operator.record(None)
    operator.record(str(tmp_path / "later"))
    states.clear()
    loop.wait(lambda: len(states) > 50, "samples")
    operator.set_parameters("controller", {"law": "pd"})
    states.clear()
    loop.wait(lambda: len(states) > 50, "samples under the new law")
    operator.deactivate("daq")
    operator.deactivate("controller")
    operator.record(None)
    operator.set_parameters("controller", {"law": "pdpc"})
    loop.node.destroy_subscription(heard)

    pdpc, pd = (("/flexarm/controller", law, True) for law in ("pdpc", "pd"))
    assert declarations(tmp_path / "first") == [pdpc]
    assert declarations(tmp_path / "later") == [pdpc, pd]
    assert check_bag(tmp_path / "later").problems == ()


def test_lone_daq___samples_at_once_and_its_clock_is_followed(graph: Graph) -> None:
    states: list[ArmState] = []
    times: list[Clock] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    graph.node.create_subscription(Clock, "/clock", times.append, qos.NEWEST)
    graph.start(
        "daq",
        {"autostart": True, "rate_hz": 50.0, "answer_timeout_s": LONGEST_TIMEOUT_S},
    )
    graph.wait(lambda: bool(states), "a sample")
    # Of samples that waited for an answer, one would come in that time, on a machine of any speed.
    graph.wait(lambda: len(states) > 20, "samples", 2.0 * LONGEST_TIMEOUT_S)
    graph.node.set_parameters([Parameter("use_sim_time", value=True)])
    clock = graph.node.get_clock()

    def follows() -> bool:
        stamps = {stamp_ns(state.header.stamp) for state in states}
        return clock.now().nanoseconds in stamps

    graph.wait(follows, "the time of a sample")
    assert times
    assert not any(state.command_v for state in states)


@pytest.mark.exhaustive
def test_nodes_on_the_arms_time___work_as_on_the_wall_clocks(graph: Graph, tmp_path: Path) -> None:
    sim = {"use_sim_time": True}
    graph.start("recorder", sim)
    graph.start("controller", LAW | sim)
    graph.start("daq", sim)
    graph.configure_loop()
    graph.operator.await_recorder()
    bag = tmp_path / "run"

    run, states = recorded(graph, bag, 600)

    assert (run.taken, run.missed) == (600, 0)
    np.testing.assert_array_equal(states.sequence, np.arange(1, 601))
    assert np.any(states.command_v != 0.0)
    assert abs(states.stamp_s[0] - bag.stat().st_mtime) < 3600.0
    assert check_bag(bag).problems == ()


def test_pace_that_cannot_be___is_refused_in_one_line(loop: Graph) -> None:
    assert loop.refusal("daq", {"real_time_factor": 0.001}) == (
        "parameter real_time_factor = 0.001: must be 0, as fast as it goes, or 0.01 to 100"
    )


def test_run_whose_rig_fails___is_no_run(loop: Graph) -> None:
    fault = {"fault": "read_error", "fault_after_samples": 100}
    loop.operator.set_parameters("daq", {"real_time_factor": 0.0, **fault})
    loop.operator.activate("controller")
    with pytest.raises(
        LaunchError, match=r"^daq: the loop has ended: .*, after 0\.330 s of the run"
    ):
        loop.operator.sample(4000, lambda _: None)
