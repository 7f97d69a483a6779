"""Simulated laboratory in one process, where there is no ROS 2 for this machine."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from flexarm_bringup.console import terminal
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.runs.direct_run import DirectRun
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.verbs.simulated.simulated_run import (
    ENTRY,
    MODELS_FOLDER,
    REPLY_DELAY_S,
    IdentifiedModel,
    SimulatedRun,
)
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, RigParameters
from flexarm_daq.rigs.simulated import SimulatedRig
from flexarm_ident.job import identify_bags, model_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_bringup.verbs.simulated.simulated_run import RunSettings
    from flexarm_ident.workflow.request import Request


class OneProcess(SimulatedRun):
    """Laboratory without nodes: rig, law and recorder are called one after the other."""

    followed_by = "flexarm design, for controllers from such a model (docs/howto/without_ros.md)"

    def __init__(self, bags: Path, settings: RunSettings) -> None:
        super().__init__(bags, settings)
        self._controller: dict[str, Any] = {}
        self.change_seed(settings.seed)

    def record(
        self, controller: Mapping[str, Any], bag: Path, samples: int, *, text: str
    ) -> RecordedRun:
        """Run the loop here; see `SimulatedRun.record`."""
        self._controller |= controller
        run = DirectRun(
            rig=self._rig,
            rate_hz=ENTRY.rate_hz,
            samples=samples,
            real_time_factor=0.0 if self.settings.pace is Pace.FAST else 1.0,
            namespace=self.settings.namespace,
        )
        return run.record(self._controller, bag, text=text)

    def change_seed(self, seed: int) -> None:
        """Make a rig with that noise; see `SimulatedRun.change_seed`."""
        parameters = RigParameters(
            payload_kg=self.settings.payload_kg, noise_v=LOW_NOISE_V, loop_delay_s=REPLY_DELAY_S
        )
        self._rig = SimulatedRig(parameters, rate_hz=ENTRY.rate_hz, seed=seed)

    def identified(self, bag: Path, request: Request) -> IdentifiedModel:
        """Identify here; see `SimulatedRun.identified`."""
        started_s = time.monotonic()
        settings = self.settings
        folder = settings.out / MODELS_FOLDER / model_name(bag)
        results = identify_bags([bag], folder, request, force=settings.force)
        return IdentifiedModel(
            text=results.text(time.monotonic() - started_s),
            facts=terminal.facts_of(results)._replace(frequency_std_hz=()),
            folder=folder,
        )


@contextmanager
def one_process(settings: RunSettings) -> Iterator[SimulatedRun]:
    """Run without nodes.

    Raises
    ------
    LaunchError
        When the settings need nodes.
    """
    if settings.live or settings.pace is Pace.REAL:
        option = "--live" if settings.live else "--real-time"
        raise LaunchError(
            f"{option} needs nodes, and there is no ROS 2 for this Python: leave it out, or run "
            "where ROS 2 Jazzy or Kilted is"
        )
    terminal.step(
        "No ROS 2 for this Python: rig, controller and recorder run in this process, without nodes"
    )
    with settings.bag_folder() as bags:
        yield OneProcess(bags, settings)
