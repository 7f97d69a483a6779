"""Way from excitation to a model and a controlled step on the simulated arm, for demo and design.

The closed-loop experiment has the shape of C_dat3 (Table A-3): PD with compensation, 3 V square
wave with half-periods of 2.5 to 5 s, 12000 samples at 300 Hz.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from flexarm_bringup.console import terminal
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.verbs.simulated.run_settings import EXPERIMENT
from flexarm_bringup.verbs.simulated.step_results import SET_POINT_V, ControlledStep
from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.records.iodata import ARM_OUTPUTS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_bringup.verbs.simulated.run_settings import RunSettings
    from flexarm_ident.models.modes import Mode
    from flexarm_ident.workflow.request import Request

ENTRY = experiment("C_dat3")
# A reply takes about that long over DDS.
REPLY_DELAY_S = 6e-4
_STEP_S = 10.0


class SimulatedRun(ABC):
    """Laboratory with the simulated arm at work.

    Parameters
    ----------
    bags : Path
        Folder of the bags.
    settings : RunSettings
        Choices of the user.
    """

    followed_by: ClassVar[str]
    """Command that a user tries next, and where it is described."""

    def __init__(self, bags: Path, settings: RunSettings) -> None:
        self.settings = settings
        self._bags = bags

    @property
    def experiment_bag(self) -> Path:
        """Bag of the closed-loop experiment."""
        return self._bags / EXPERIMENT

    def begin(self, words: str) -> None:
        """Tell the user what comes next."""
        terminal.step(words)

    def excite(self) -> RecordedRun:
        """Record the closed-loop experiment."""
        settings = self.settings
        pace = "as fast as it goes" if settings.pace is Pace.FAST else f"{ENTRY.length_s:.0f} s"
        self.begin(
            f"Closed-loop experiment, {settings.payload_kg * 1e3:.0f} g payload: "
            f"{ENTRY.samples} samples at {ENTRY.rate_hz:.0f} Hz, {pace}"
        )
        controller = ENTRY.commander_parameters(settings.seed)
        bag = self.experiment_bag
        return self.record(controller, bag, ENTRY.samples, text="exciting the arm")

    def identify(self, request: Request) -> IdentifiedModel:
        """Identify a model from the experiment and print it."""
        return self.shown(lambda: self.identified(self.experiment_bag, request))

    def shown(self, identified: Callable[[], IdentifiedModel], beside: str = "") -> IdentifiedModel:
        """Print a model and return it; until it is there, print what is being worked on."""
        with terminal.busy(f"subspace identification of the recorded bag{beside}"):
            model = identified()
        model.show()
        return model

    def begin_identify(self, request: Request) -> Callable[[], IdentifiedModel]:
        """Identify a model, beside the next runs where that saves time; the result waits for it."""
        model = self.identify(request)
        return lambda: model

    def step(
        self, name: str, law: Mapping[str, Any], *, length_s: float = _STEP_S
    ) -> ControlledStep:
        """Record a step to 3 V with a law, its parameters as those of the controller node."""
        controller = {**law, "reference": "step", "step.amplitude_v": SET_POINT_V}
        samples = round(length_s * ENTRY.rate_hz)
        recorded = self.record(controller, self._bags / name, samples, text="stepping")
        return ControlledStep.of(recorded)

    def repeat(self, number: int, controller: Mapping[str, Any], samples: int) -> RecordedRun:
        """Record a repetition of a run, each with noise of its own."""
        self.change_seed(self.settings.seed + number)
        bag = self._bags / f"repetition_{number}"
        return self.record(controller, bag, samples, text=f"repetition {number}")

    def end_runs(self) -> None:  # noqa: B027 - most have nothing to end
        """Tell that no run follows: what runs need may end beside the rest of the work."""

    @abstractmethod
    def change_seed(self, seed: int) -> None:
        """Change the seed of the noise of the following runs."""

    @abstractmethod
    def record(
        self, controller: Mapping[str, Any], bag: Path, samples: int, *, text: str
    ) -> RecordedRun:
        """Run the loop from rest and record it.

        Parameters
        ----------
        controller : mapping of str to value
            Parameters of the controller that change; the others stay.
        bag : Path
            Bag to create.
        samples : int
            Length of the run.
        text : str
            Words beside the progress.
        """

    @abstractmethod
    def identified(self, bag: Path, request: Request) -> IdentifiedModel:
        """Identify a model from a bag and write it to the folder of the results."""


class IdentifiedModel(NamedTuple):
    """Identified model of the arm.

    Attributes
    ----------
    text : str
        Verdict, orders and time in one line.
    modes : sequence of Mode
        Modes of the full model; those of the reduced one are marked as kept.
    dmv, left_out, sfv : sequence of float
        Errors of the outputs and their mean: data matching, on blocks left out of the fit,
        set-point following. The last two may be empty.
    parameters : mapping
        The model as flat parameters `models.<name>.*`.
    warnings : sequence of str
        Facts that a user should know.
    folder : Path
        Folder of the model and its report.
    """

    text: str
    modes: Sequence[Mode]
    dmv: Sequence[float]
    left_out: Sequence[float]
    sfv: Sequence[float]
    parameters: Mapping[str, Any]
    warnings: Sequence[str]
    folder: Path

    @property
    def order(self) -> int:
        """States of the full model."""
        return sum(len(mode.states) for mode in self.modes)

    @property
    def reduced_order(self) -> int:
        """States of the reduced model."""
        return sum(len(mode.states) for mode in self.modes if mode.kept)

    def show(self) -> None:
        """Print modes, errors and warnings."""
        terminal.CONSOLE.print(f"  {self.text}")
        terminal.show_model(
            terminal.ShownModel(
                modes=self.modes,
                outputs=ARM_OUTPUTS,
                dmv=self.dmv,
                left_out=self.left_out,
                sfv=self.sfv,
                parameters=self.parameters,
                warnings=self.warnings,
            )
        )

    def kept_modes_hz(self, known_modes_hz: Sequence[float]) -> list[float]:
        """Return the reduced model's flexible modes, one for each known one; none without pairs."""
        pairs = [mode for mode in self.modes if mode.kept and mode.is_pair]
        if not pairs:
            return []
        return [
            min(pairs, key=lambda mode: abs(math.log(mode.frequency_hz / known))).frequency_hz
            for known in known_modes_hz
        ]
