"""Runs of experiments of the thesis on the live graph, a bag each, described in a manifest."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_bags.check import check_bag
from flexarm_bags.metadata import BAG_FILES
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.runs.live_arm import LiveArm, answers_to_pulses, live_arm
from flexarm_bringup.runs.recorded_run import new_record, record_run, workplace
from flexarm_bringup.verbs.laboratory.options import USUAL_RIG, rig_parameter
from flexarm_control.commissioning.answers import soft_loop
from flexarm_control.joint_laws import require_known_outputs
from flexarm_control.laws.registry import LAWS
from flexarm_core.channels import is_thesis_arm
from flexarm_core.errors import reason
from flexarm_core.outputs import require_folder
from flexarm_core.rig_description import load_rig
from flexarm_daq.experiments.catalogue import on_rig
from flexarm_daq.loop.limiter import LimiterSettings
from flexarm_ident.provenance import samples_hash

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_bags.check import BagCheck
    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.runs.pace import Pace
    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import RigDescription
    from flexarm_daq.experiments.catalogue import Experiment

MANIFEST = "experiments.json"


@dataclass(frozen=True)
class ExperimentSettings:
    """Choices of the user.

    Attributes
    ----------
    folder : Path
        Folder that gets a bag for each experiment, by its name.
    pace : Pace
        Wall clock, fast or hard real time.
    seed : int
        Seed of the sensor noise and of random excitations.
    overwrite : bool
        Replace bags that are there, each when its new record is complete.
    parameter_files : tuple of Path
        As for `--params-file` of ROS 2, such as the wiring of a board; the parameters of an
        experiment come after them.
    namespace : str
        Namespace of the arm.
    rig : str
        Name or file of its description.
    payload_kg : float, optional
        Payload instead of the experiment's own.
    """

    folder: Path
    pace: Pace
    seed: int
    overwrite: bool
    parameter_files: tuple[Path, ...]
    namespace: str
    rig: str = USUAL_RIG
    payload_kg: float | None = None


def run_experiments(entries: Sequence[Experiment], settings: ExperimentSettings) -> None:
    """Run experiments one after the other and describe the bags in a manifest.

    An incomplete or refused record is kept as `NAME.partial`.

    Raises
    ------
    LaunchError
        For a repeated name, an existing bag, an unreadable manifest, or an incomplete or damaged
        record.
    """
    rig = load_rig(settings.rig)
    if settings.payload_kg and not is_thesis_arm(rig):
        raise LaunchError(f"--payload loads the thesis's arm, and {rig.name} is another")
    entries = [on_rig(each, rig) for each in entries]
    # Of another arm it is asked for by those in closed loop alone: not every rig has joints.
    with_controller = is_thesis_arm(rig) or any(each.closed_loop for each in entries)
    if with_controller and not is_thesis_arm(rig):
        require_known_outputs(LAWS["pd"], rig)
    folder = settings.folder.absolute()
    _make_room(folder, entries, overwrite=settings.overwrite)
    # A record is settled when the recorder has closed it: after the graph.
    with (
        ExitStack() as records,
        live_arm(
            rig,
            rig_parameter(settings.rig),
            folder,
            pace=settings.pace,
            namespace=settings.namespace,
            seed=settings.seed,
            files=settings.parameter_files,
            with_controller=with_controller,
        ) as arm,
    ):
        operator = arm.operator
        entries = _with_gains(entries, rig, operator, folder)
        for number, entry in enumerate(entries, start=1):
            words = f"{entry.input_text_on(rig)}, {entry.samples} samples at {entry.rate_hz:g} Hz"
            terminal.step(f"{number} of {len(entries)}: {entry.name}, {words}")
            bag = folder / entry.name
            record = records.enter_context(new_record(bag))
            commander = _prepare(operator, entry, settings)
            recorded = record_run(
                operator, commander, record, entry.samples, text="sampling", bag=bag
            )
            check = check_bag(bag)
            _describe(folder, entry, recorded, check.problems, settings)
            _show_extent(recorded, rig)
            require_good(check)
    count = len(entries)
    terminal.step(f"{count} bag{'s' * (count != 1)} in {settings.folder}, described in {MANIFEST}")


def require_good(check: BagCheck) -> None:
    """Refuse a bag with problems besides skipped periods, which its pace has reported.

    Raises
    ------
    LaunchError
        With the first of the problems.
    """
    others = [problem for problem in check.problems if problem not in check.skipped]
    if others:
        raise LaunchError(
            f"{check.bag}: {others[0]}{f' (and {len(others) - 1} more)' * (len(others) > 1)}: "
            "record again"
        )


def _with_gains(
    entries: Sequence[Experiment], rig: RigDescription, operator: Operator, folder: Path
) -> Sequence[Experiment]:
    """Give the laws of another arm the gains of a soft position loop, from its answers to pulses.

    Raises
    ------
    ArmFaultError
        When a joint does not answer as the description says.
    """
    if is_thesis_arm(rig) or not any(each.closed_loop for each in entries):
        return entries
    with TemporaryDirectory(dir=folder, prefix="pulses_") as place:
        answers = answers_to_pulses(LiveArm(operator, rig, Path(place)), rig)
    gains = soft_loop(answers, rig)._asdict()
    return [replace(each, gains=gains) if each.closed_loop else each for each in entries]


def _make_room(folder: Path, entries: Sequence[Experiment], *, overwrite: bool) -> None:
    for name, times in Counter(entry.name for entry in entries).items():
        bag = folder / name
        if times > 1:
            raise LaunchError(f"{name} is named {times} times: name each experiment once")
        if bag.exists() and not overwrite:
            raise LaunchError(f"{bag} is there already: --overwrite replaces it, -o names another")
        if bag.is_file():
            raise LaunchError(f"{bag} is a file: only a folder is replaced")
        for file in _strange_files(bag):
            raise LaunchError(f"{file} is not part of a bag: move it away, or -o names another")
        if workplace(bag).exists():
            raise LaunchError(
                f"{workplace(bag)} is there: another run records into it, or it was left by one "
                "that was killed; check the bag in it, move or remove it"
            )
    require_folder(folder, "-o")
    folder.mkdir(parents=True, exist_ok=True)
    # One that cannot be read shall show before anything runs.
    _described(folder)


def _strange_files(bag: Path) -> Iterator[Path]:
    """Yield what would be lost with a bag and is none of its files."""
    for file in bag.iterdir() if bag.is_dir() else ():
        if not any(file.match(pattern) for pattern in BAG_FILES):
            yield file


def _prepare(operator: Operator, entry: Experiment, settings: ExperimentSettings) -> str:
    """Set the nodes for an experiment and return the one that commands."""
    rig = {"rate_hz": float(entry.rate_hz), "payload_kg": _payload_kg(entry, settings)}
    operator.set_parameters("daq", rig)
    commander = "controller" if entry.closed_loop else "experiment"
    operator.set_parameters(commander, entry.commander_parameters(settings.seed))
    return commander


def _payload_kg(entry: Experiment, settings: ExperimentSettings) -> float:
    return entry.payload_kg if settings.payload_kg is None else settings.payload_kg


def _described(folder: Path) -> dict[str, Any]:
    """Return what the manifest of a folder says so far."""
    manifest = folder / MANIFEST
    try:
        known = json.loads(manifest.read_text())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise LaunchError(
            f"{manifest} cannot be read ({reason(error)}): move or remove it"
        ) from error
    if not isinstance(known, dict):
        raise LaunchError(f"{manifest} describes no experiments: move or remove it")
    return known


def _describe(
    folder: Path,
    entry: Experiment,
    recorded: RecordedRun,
    problems: Sequence[str],
    settings: ExperimentSettings,
) -> None:
    """Add a bag to the manifest; the hash is over the samples, not over the file."""
    reading = recorded.reading
    known = _described(folder)
    known[entry.name] = {
        "samples": reading.samples,
        "lost": reading.lost,
        "unanswered": reading.unanswered,
        "rate_hz": entry.rate_hz,
        "payload_kg": _payload_kg(entry, settings),
        "seed": settings.seed,
        "sha256_of_samples": samples_hash(reading.data),
        "problems": problems,
        "time": "virtual" if recorded.lockstep else "real",
    }
    draft = folder / f".{MANIFEST}"
    draft.write_text(json.dumps(known, indent=1) + "\n")
    draft.replace(folder / MANIFEST)


def _show_extent(recorded: RecordedRun, rig: RigDescription) -> None:
    """Print how far the arm and the command went."""
    data = recorded.reading.data
    if not is_thesis_arm(rig):
        for channels, values in ((rig.inputs, data.u), (rig.outputs, data.y)):
            for channel, (low, high) in zip(channels, _ends(values), strict=True):
                terminal.CONSOLE.print(
                    f"  {channel.name} from {low:.3g} to {high:.3g} {channel.unit}"
                )
        return
    largest_v = abs(data.y[:, 0]).max()
    terminal.CONSOLE.print(
        f"  position within {largest_v:.2f} V, command {abs(data.u).max():.2f} V"
    )
    bound_v = LimiterSettings().position_bound_v
    if largest_v >= bound_v:
        terminal.CONSOLE.print(
            f"  note: the arm came past {bound_v:g} V, where no command drives it further outward"
        )


def _ends(values: FloatArray) -> Iterator[tuple[float, float]]:
    """Yield the least and largest value of each channel."""
    return zip(np.nanmin(values, axis=0), np.nanmax(values, axis=0), strict=True)
