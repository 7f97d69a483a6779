"""The experiments of the catalogue on the live graph, each recorded to a bag."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.table import Table

from flexarm_bags.check import check_bag
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.laboratory import running_graph
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.runs.pace import Pace, in_lockstep, pace_text
from flexarm_bringup.runs.run_record import new_record, put_in_place, require_whole, workplace
from flexarm_daq.experiments.catalogue import KINDS, catalogue
from flexarm_daq.loop.limiter import LimiterSettings
from flexarm_ident.provenance import samples_hash
from flexarm_ident.reading.read import read_bag_report

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from flexarm_bringup.graph.operation import Operator, Run
    from flexarm_daq.experiments.catalogue import Experiment
    from flexarm_ident.reading.alignment import BagReading

MANIFEST = "experiments.json"
_NODES = ("recorder", "controller", "experiment", "daq")


@dataclass(frozen=True)
class ExperimentSettings:
    """What a user can choose.

    Attributes
    ----------
    folder
        Folder that gets a bag for each experiment, by its name.
    payload_kg
        Payload instead of the experiment's own, or None.
    seed
        Seed of the sensor noise and of random excitations.
    pace
        Wall clock, fast or hard real time.
    overwrite
        Replace bags that are there, each when its new record is complete.
    parameter_files
        As for `--params-file` of ROS 2, such as the wiring of a board; what an experiment says
        itself comes after them.
    """

    folder: Path
    payload_kg: float | None = None
    seed: int = 1
    pace: Pace = Pace.WALL_CLOCK
    overwrite: bool = False
    parameter_files: tuple[Path, ...] = ()


def run_experiments(entries: Sequence[Experiment], settings: ExperimentSettings) -> None:
    """Run experiments one after the other and describe the bags in a manifest.

    What was recorded of an experiment that does not come to its end, or of one that is refused, is
    kept as `NAME.partial`.

    Raises
    ------
    LaunchError
        When an experiment is named twice, a bag is there already, the manifest cannot be read, a
        node does not do its part, or a record is not whole.
    """
    folder = settings.folder.absolute()
    _make_room(folder, entries, overwrite=settings.overwrite)
    settings.pace.prepare()
    parameters = {"daq": settings.pace.parameters() | {"seed": settings.seed}}
    files = settings.parameter_files
    log = folder / "nodes.log"
    # A record is settled when the recorder has closed it: after the graph.
    with (
        ExitStack() as records,
        running_graph(parameters, log, nodes=_NODES, files=files) as (operator, _),
    ):
        lockstep = in_lockstep(operator)
        for number, entry in enumerate(entries, start=1):
            terminal.step(f"{number} of {len(entries)}: {entry.name}, {_words(entry)}")
            bag = folder / entry.name
            record = records.enter_context(new_record(bag))
            run = _record(operator, entry, record, settings)
            reading = read_bag_report(record)
            require_whole(reading, run.taken, lockstep=lockstep)
            put_in_place(record, bag)
            terminal.CONSOLE.print(f"  recorded {run.recorded.replace(str(record), str(bag))}")
            terminal.CONSOLE.print(f"  {pace_text(run)}")
            problems = check_bag(bag).problems
            for problem in problems:
                terminal.CONSOLE.print(f"  problem: {problem}", markup=False)
            time = "virtual" if lockstep else "real"
            _describe(folder, entry, reading, {"problems": problems, "time": time}, settings)
    terminal.step(f"{len(entries)} bags in {settings.folder}, described in {MANIFEST}")


def show_catalogue() -> None:
    """Print the experiments as one table."""
    table = Table("name", "kind", "length", "rate", "payload", "input", box=None, header_style="")
    for entry in catalogue().values():
        table.add_row(
            entry.name,
            KINDS[entry.kind],
            f"{entry.samples}",
            f"{entry.rate_hz:g} Hz",
            f"{1e3 * entry.payload_kg:.0f} g",
            entry.input_text,
        )
    terminal.CONSOLE.print(table)


def _make_room(folder: Path, entries: Sequence[Experiment], *, overwrite: bool) -> None:
    for name, times in Counter(entry.name for entry in entries).items():
        bag = folder / name
        if times > 1:
            raise LaunchError(f"{name} is named {times} times: name each experiment once")
        if bag.exists() and not overwrite:
            raise LaunchError(f"{bag} is there already: --overwrite replaces it, -o names another")
        if bag.is_file():
            raise LaunchError(f"{bag} is a file: only a folder is replaced")
        if workplace(bag).exists():
            raise LaunchError(
                f"{workplace(bag)} is there: another run records into it, or it was left by one "
                "that was killed; check the bag in it, move or remove it"
            )
    folder.mkdir(parents=True, exist_ok=True)
    # One that cannot be read shall show before anything runs.
    _described(folder)


def _record(operator: Operator, entry: Experiment, bag: Path, settings: ExperimentSettings) -> Run:
    """Record one experiment."""
    payload_kg = entry.payload_kg if settings.payload_kg is None else settings.payload_kg
    operator.set_parameters("daq", {"rate_hz": float(entry.rate_hz), "payload_kg": payload_kg})
    commander = "controller" if entry.closed_loop else "experiment"
    operator.set_parameters(commander, commander_parameters(entry, settings.seed))
    with terminal.progress_bar("sampling", entry.samples) as progress:
        return operator.recorded_run(commander, str(bag), entry.samples, progress)


def commander_parameters(entry: Experiment, seed: int) -> dict[str, Any]:
    """Return the parameters of the node that commands in an experiment."""
    if not entry.closed_loop:
        return {"waveform": entry.waveform, "magnitude_v": entry.magnitude_v, "seed": seed}
    profile = dict(entry.profile)
    parameters: dict[str, Any] = {"law": entry.law, "reference": entry.reference}
    parameters |= _below(entry.law, entry.gains) | _below(entry.reference, profile)
    if entry.reference == "varying_square":
        parameters["varying_square.seed"] = seed
    return parameters


def _below(prefix: str, values: Mapping[str, float]) -> dict[str, float]:
    return {f"{prefix}.{name}": float(value) for name, value in values.items()}


def _words(entry: Experiment) -> str:
    return f"{entry.input_text}, {entry.samples} samples at {entry.rate_hz:g} Hz"


def _described(folder: Path) -> dict[str, Any]:
    """Return what the manifest of a folder says so far."""
    manifest = folder / MANIFEST
    try:
        known = json.loads(manifest.read_text())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise LaunchError(f"{manifest} cannot be read ({error}): move or remove it") from error
    if not isinstance(known, dict):
        raise LaunchError(f"{manifest} describes no experiments: move or remove it")
    return known


def _describe(
    folder: Path,
    entry: Experiment,
    reading: BagReading,
    more: dict[str, Any],
    settings: ExperimentSettings,
) -> None:
    """Add what a bag holds to the manifest; the hash is over the samples, not over the file."""
    data = reading.data
    known = _described(folder)
    known[entry.name] = {
        "samples": reading.samples,
        "lost": reading.lost,
        "unanswered": reading.unanswered,
        "rate_hz": entry.rate_hz,
        "payload_kg": entry.payload_kg if settings.payload_kg is None else settings.payload_kg,
        "seed": settings.seed,
        "sha256_of_samples": samples_hash(data),
    } | more
    draft = folder / f".{MANIFEST}"
    draft.write_text(json.dumps(known, indent=1) + "\n")
    draft.replace(folder / MANIFEST)
    largest_v = abs(data.y[:, 0]).max()
    terminal.CONSOLE.print(
        f"  position within {largest_v:.2f} V, command {abs(data.u).max():.2f} V"
    )
    bound_v = LimiterSettings().position_bound_v
    if largest_v >= bound_v:
        terminal.CONSOLE.print(
            f"  note: the arm came past {bound_v:g} V, where no command drives it further outward"
        )
