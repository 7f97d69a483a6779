"""Way from excitation to a model and a controlled step on the simulated arm, for demo and design.

The closed-loop experiment has the shape of C_dat3 (Table A-3): PD with compensation, 3 V square
wave with half-periods of 2.5 to 5 s, 12000 samples at 300 Hz.
"""

from __future__ import annotations

import math
import os
import platform
import shutil
from abc import ABC, abstractmethod
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import click
import numpy as np

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE, together
from flexarm_bringup.graph.processes import HeldDriveError
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.verbs.laboratory.options import ARM, LIVE, PAYLOAD, paced
from flexarm_control.design.criteria import step_figures, strain_settling_s
from flexarm_core import __version__
from flexarm_core.outputs import MARK, OutputError, is_replaceable, require_place
from flexarm_core.own_files import claimed
from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident.job import result_files
from flexarm_ident.report.content.blocks import Plots, Words
from flexarm_ident.report.plots.time_plots import step_plot

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_control.design.criteria import StepFigures
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.workflow.request import Request

ENTRY = experiment("C_dat3")
# A reply takes about that long over DDS.
REPLY_DELAY_S = 6e-4
_STEP_S = 10.0
SUMMARY_FILE = "summary.json"
REPORT_FILE = "report.html"
EXPERIMENT = "experiment"
"""Name of the record that is identified, and of its model."""
MODELS_FOLDER = "models"
_BAG_FOLDER = "bag"
_LEFT_OVER = ".flexarm"
SET_POINT_V = 3.0
# A move and its correction turn the compensation a few times.
_MANY_TURNS = 10
_VERSIONED = ("numpy", "scipy", "control", "numba", "rosbags", "mcap")


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
    """Identified model of the arm: one line on it, its facts, and the folder of its files.

    Of the modes those of the reduced model are marked as kept.
    """

    text: str
    facts: terminal.ShownModel
    folder: Path

    @property
    def order(self) -> int:
        """States of the full model."""
        return sum(len(mode.states) for mode in self.facts.modes)

    @property
    def reduced_order(self) -> int:
        """States of the reduced model."""
        return sum(len(mode.states) for mode in self.facts.modes if mode.kept)

    def show(self) -> None:
        """Print modes, errors and warnings."""
        terminal.CONSOLE.print(f"  {self.text}")
        terminal.show_model(self.facts)

    def kept_modes_hz(self, known_modes_hz: Sequence[float]) -> list[float]:
        """Return the reduced model's flexible modes, one for each known one; none without pairs."""
        pairs = [mode for mode in self.facts.modes if mode.kept and mode.is_pair]
        if not pairs:
            return []
        return [
            min(pairs, key=lambda mode: abs(math.log(mode.frequency_hz / known))).frequency_hz
            for known in known_modes_hz
        ]


@dataclass(frozen=True)
class RunSettings:
    """Choices of the user.

    `keep_bag` keeps the bags in the folder of the results, `force` replaces what somebody else or
    an earlier `keep_bag` left there. `live` serves a page that looks on.
    """

    out: Path
    payload_kg: float
    seed: int
    pace: Pace
    keep_bag: bool
    force: bool
    live: bool
    namespace: str

    def results_text(self) -> str:
        """Return where the results are, for the user."""
        kept = str(self.out / _BAG_FOLDER) if self.keep_bag else "removed, --keep-bag keeps them"
        return f"Report: {self.out / REPORT_FILE}. Bags: {kept}"

    def make_room(self) -> None:
        """Refuse, before any work, to replace what somebody else or `keep_bag` left in the folder.

        Raises
        ------
        OutputError
            When a result would replace something of somebody else.
        """
        out = self.out
        models = result_files(out / MODELS_FOLDER / EXPERIMENT, ())
        require_place([out / SUMMARY_FILE, out / REPORT_FILE, *models], force=self.force)
        bags = out / _BAG_FOLDER
        is_left_over = (bags / _LEFT_OVER).is_file() and is_replaceable(bags / _LEFT_OVER)
        if bags.exists() and not (self.force or is_left_over):
            raise OutputError(
                f"{bags}: holds bags that were kept, or something else: move it away, choose "
                "another --out, or replace it with --force"
            )

    @contextmanager
    def bag_folder(self) -> Iterator[Path]:
        """Give an empty folder for bags; remove it at the end, unless kept.

        The bags of a run whose drive was held are evidence: they stay until the next run.

        Raises
        ------
        OutputError
            When another run is at work in the folder of the results.
        """
        self.out.mkdir(parents=True, exist_ok=True)
        taken = OutputError(
            f"{self.out}: another run is at work there: choose another --out, or wait for it"
        )
        # Another run would take these bags away.
        with claimed(os.open(self.out, os.O_RDONLY), taken):
            yield from self._emptied()

    def _emptied(self) -> Iterator[Path]:
        folder = self.out / _BAG_FOLDER
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        if not self.keep_bag:
            # A run that is killed leaves the folder: the next one may remove it.
            (folder / _LEFT_OVER).write_text(f"{MARK}\n", "utf-8")
        keeps = self.keep_bag
        try:
            yield folder.absolute()
        except HeldDriveError:
            keeps = True
            terminal.CONSOLE.print(f"what was recorded is kept in {folder}")
            raise
        finally:
            if not keeps:
                shutil.rmtree(folder, ignore_errors=True)


run_options = together(
    PAYLOAD,
    click.option(
        "--seed",
        type=click.IntRange(0),
        default=1,
        show_default=True,
        help="Seed of the noise.",
    ),
    paced,
    click.option("--keep-bag", is_flag=True, help="Keep the recorded bags in OUT/bag."),
    LIVE,
    FORCE,
    ARM,
)
"""Options of `RunSettings`, but for the folder."""


class ControlledStep(NamedTuple):
    """Recorded step from rest to `SET_POINT_V`, its figures, and when its vibration settled.

    From `calm_s` on, s, the strain at the base is within a tenth of its peak; infinite for never.
    """

    recorded: RecordedRun
    figures: StepFigures
    calm_s: float

    @classmethod
    def of(cls, recorded: RecordedRun) -> ControlledStep:
        """Return a run with the figures of its step."""
        data = recorded.reading.data
        figures = step_figures(_time_s(data), data.y[:, 0], SET_POINT_V)
        return cls(recorded, figures, strain_settling_s(data.y[:, 1], dt_s=data.dt_s))

    @property
    def text(self) -> str:
        """Figures for the terminal."""
        figures = self.figures
        return (
            f"mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
            f"overshoot {100 * figures.overshoot:.1f} %, "
            f"settling time (5 %) {_shown(figures.settling_s)}, "
            f"residual vibration settled after {_shown(self.calm_s)}"
        )

    @property
    def over_s(self) -> float:
        """Time from which the arm is at the set-point and its vibration settled, s."""
        return max(self.figures.settling_s, self.calm_s)

    def summary(self) -> dict[str, Any]:
        """Return the figures for `summary.json`."""
        figures = self.figures
        return {
            "set_point_v": SET_POINT_V,
            "mean_error_v": figures.mean_error_v,
            "overshoot": figures.overshoot,
            "settling_s": figures.settling_s if math.isfinite(figures.settling_s) else None,
            "calm_s": self.calm_s if math.isfinite(self.calm_s) else None,
        }

    def blocks(self, title: str) -> tuple[Words | Plots, ...]:
        """Return the step for a report."""
        data, figures = self.recorded.reading.data, self.figures
        words = (
            f"{title}, step to {SET_POINT_V:g} V. "
            f"Mean error over the last 2 s {figures.mean_error_v:+.4f} V, "
            f"overshoot {100 * figures.overshoot:.1f} %, "
            f"settling time (5 %) {_shown(figures.settling_s)}, "
            f"residual vibration (base strain below a tenth of its peak) settled after "
            f"{_shown(self.calm_s)}."
        )
        set_point_v = np.full(len(data), SET_POINT_V)
        plot = step_plot(_time_s(data), data.y, set_point_v, data.u[:, 0])
        return Words(words), Plots((("", plot),)), *map(Words, switching_words(data))


def switching_words(data: IoData) -> list[str]:
    """Return what a compensation that turns again and again makes of the command; or nothing."""
    if data.compensation is None:
        return []
    acting_v = data.compensation[data.compensation != 0.0]
    turns = int(np.count_nonzero(np.diff(np.sign(acting_v))))
    if turns < _MANY_TURNS:
        return []
    level_v = float(np.abs(acting_v).max())
    words = (
        f"Where the command fills a band, the Coulomb compensation of ±{level_v:g} V switches, "
        f"here {turns} times: it has the sign of the effort (4-8), which is near zero there and "
        "turns with the least speed or noise. It makes up for friction."
    )
    return [words]


def _shown(time_s: float) -> str:
    """Return a time for people; one that never comes is a dash."""
    return f"{time_s:.2f} s" if math.isfinite(time_s) else "-"


def _time_s(data: IoData) -> FloatArray:
    return np.arange(len(data), dtype=np.float64) * data.dt_s


def versions() -> dict[str, str]:
    """Return the versions of what computed the results."""
    return {
        "python": platform.python_version(),
        "ros_distro": os.environ.get("ROS_DISTRO", "none"),
        "flexarm": __version__,
        **{name: version(name) for name in _VERSIONED},
    }
