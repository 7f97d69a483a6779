"""Simulated laboratory of real nodes."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.parameter import Parameter

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import LABORATORY, running_graph
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.runs.recorded_run import record_run
from flexarm_bringup.verbs.laboratory.live_page import (
    PAGE_NODE,
    PageAddress,
    PageSettings,
    announce_task,
)
from flexarm_bringup.verbs.simulated.simulated_run import (
    ENTRY,
    MODELS_FOLDER,
    REPLY_DELAY_S,
    IdentifiedModel,
    SimulatedRun,
)
from flexarm_ident.models.modes import Mode
from flexarm_ident.records.iodata import ARM_OUTPUTS
from flexarm_msgs.srv import Identify

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.graph.processes import NodeProcesses
    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_bringup.verbs.simulated.simulated_run import RunSettings
    from flexarm_ident.workflow.request import Request
    from flexarm_msgs.msg import ModeSummary


# Both nodes of the loop end when every reader has acknowledged all that they sent, or after some
# seconds. What comes then comes with the next heartbeat, within 0.1 s.
_QUIET_S = 0.1


class NodeRun(SimulatedRun):
    """Laboratory of nodes; `operator` operates them, and `processes` are theirs."""

    followed_by = "flexarm experiment C_dat3, for a record of your own (docs/tutorial.md)"

    def __init__(
        self, operator: Operator, processes: NodeProcesses, bags: Path, settings: RunSettings
    ) -> None:
        super().__init__(bags, settings)
        self._operator = operator
        self._processes = processes

    def begin(self, words: str) -> None:
        """Tell the user what comes next, on the page too."""
        super().begin(words)
        if self.settings.live:
            announce_task(self.settings.namespace, words)

    def record(
        self, controller: Mapping[str, Any], bag: Path, samples: int, *, text: str
    ) -> RecordedRun:
        """Run the loop by its nodes; see `SimulatedRun.record`."""
        self._operator.set_parameters("controller", controller)
        return record_run(self._operator, "controller", bag, samples, text=text)

    def change_seed(self, seed: int) -> None:
        """Set the DAQ node's parameter; see `SimulatedRun.change_seed`."""
        self._operator.set_parameters("daq", {"seed": seed})

    def identified(self, bag: Path, request: Request) -> IdentifiedModel:
        """Call the service; see `SimulatedRun.identified`."""
        return _model(self._operator.identify(_asked(bag, request)))

    def begin_identify(self, request: Request) -> Callable[[], IdentifiedModel]:
        """Let the ident node work beside the next runs, where nobody wants to watch the arm."""
        if self.settings.pace is not Pace.FAST:
            return super().begin_identify(request)
        answered = self._operator.begin_identify(_asked(self.experiment_bag, request))
        return lambda: self.shown(lambda: _model(answered()), ", beside the runs")

    def end_runs(self) -> None:
        """End the loop and the recorder, where an identification is still at work."""
        if self.settings.pace is Pace.FAST:
            self._processes.end("loop_node", "recorder_node")


@contextmanager
def node_run(settings: RunSettings) -> Iterator[SimulatedRun]:
    """Run the nodes of a laboratory.

    Raises
    ------
    LaunchError
        When a node does not do its part.
    """
    settings.pace.prepare()
    out = settings.out
    with settings.bag_folder() as bags:
        nodes = (*LABORATORY, PAGE_NODE) if settings.live else LABORATORY
        terminal.step(f"Starting the nodes: {', '.join(reversed(nodes))}")
        with running_graph(
            _start_parameters(settings),
            out / "nodes.log",
            nodes=nodes,
            namespace=settings.namespace,
        ) as (operator, processes):
            if settings.live:
                page = PageAddress(settings.namespace, processes)
                operator.wait(page.look, "the page")
            yield NodeRun(operator, processes, bags, settings)


def _start_parameters(settings: RunSettings) -> dict[str, dict[str, Any]]:
    return {
        "daq": {
            "rate_hz": float(ENTRY.rate_hz),
            "payload_kg": settings.payload_kg,
            "seed": settings.seed,
            "reply_delay_s": REPLY_DELAY_S,
            **settings.pace.parameters(),
        },
        "recorder": {"quiet_s": _QUIET_S},
        "ident": {
            "output_folder": str((settings.out / MODELS_FOLDER).absolute()),
            "force": settings.force,
        },
        PAGE_NODE: PageSettings(port=0, view_only=True).parameters(),
    }


def _asked(bag: Path, request: Request) -> Identify.Request:
    """Return a request as the service takes it, where an empty field means what None means."""
    values = {each.name: getattr(request, each.name) for each in fields(request)}
    given = {name: value for name, value in values.items() if value is not None}
    given["known_modes_hz"] = list(request.known_modes_hz)
    return Identify.Request(bag_uris=[str(bag)], **given)


def _model(response: Identify.Response) -> IdentifiedModel:
    parameters = {
        each.name: Parameter.from_parameter_msg(each).value for each in response.parameters
    }
    facts = terminal.ShownModel(
        modes=_modes(response.modes),
        outputs=ARM_OUTPUTS,
        dmv=response.dmv,
        left_out=response.left_out,
        sfv=response.sfv,
        parameters=parameters,
        warnings=response.warnings,
    )
    return IdentifiedModel(response.message, facts, Path(response.report_path))


def _modes(summaries: Sequence[ModeSummary]) -> list[Mode]:
    """Return modes with their states numbered in the order of the answer."""
    modes: list[Mode] = []
    first = 0
    for each in summaries:
        states = (first, first + 1) if each.eigenvalue_imaginary > 0.0 else (first,)
        first += len(states)
        modes.append(
            Mode(
                eigenvalue=complex(each.eigenvalue_real, each.eigenvalue_imaginary),
                frequency_hz=each.frequency_hz,
                damping_ratio=each.damping_ratio,
                states=states,
                msv=each.msv,
                mrm=each.mrm,
                msv_rank=each.msv_rank,
                mrm_rank=each.mrm_rank,
                kept=each.kept,
            )
        )
    return modes
