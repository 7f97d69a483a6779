"""Verbs experiment and catalogue: experiments of the thesis on the live graph, a bag each."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from flexarm_bags.check import check_bag
from flexarm_bags.metadata import BAG_FILES
from flexarm_bringup.console import terminal
from flexarm_bringup.console.quantity import MASS_KG, Quantity
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.graph.laboratory import running_graph
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.runs.record_place import new_record, workplace
from flexarm_bringup.runs.recorded_run import record_run
from flexarm_bringup.verbs.laboratory.options import ARM, PARAMETER_FILES, paced
from flexarm_daq.experiments import catalogue as experiments
from flexarm_daq.loop.limiter import LimiterSettings
from flexarm_ident.provenance import samples_hash

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.runs.pace import Pace
    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_daq.experiments.catalogue import Experiment

MANIFEST = "experiments.json"
_NODES = ("recorder", "controller", "experiment", "daq")


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
    payload_kg : float, optional
        Payload instead of the experiment's own.
    """

    folder: Path
    pace: Pace
    seed: int
    overwrite: bool
    parameter_files: tuple[Path, ...]
    namespace: str
    payload_kg: float | None = None


def _run_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of a run: pace, seed, folder and parameter files."""
    options = (
        paced,
        click.option(
            "--seed",
            type=click.IntRange(0),
            default=1,
            show_default=True,
            help="Seed of the noise and of random excitations.",
        ),
        click.option(
            "-o",
            "--out",
            "folder",
            type=click.Path(file_okay=False, path_type=Path),
            default=Path("out/experiments"),
            show_default=True,
            help="Folder that gets a bag for each.",
        ),
        click.option("--overwrite", is_flag=True, help="Replace bags that are there."),
        PARAMETER_FILES,
        ARM,
    )
    for option in reversed(options):
        function = option(function)
    return function


@click.command()
@click.argument("names", nargs=-1, required=True)
@click.option(
    "--payload",
    "payload_kg",
    type=Quantity(MASS_KG, 0.0, 1.0),
    metavar="MASS",
    help="Instead of its own, kg, or with its unit: 200g.",
)
@_run_options
@examples(
    "experiment C_dat3",
    "experiment B_dat9 --fast --seed 7",
    "experiment C_dat3 --payload 200g",
    "experiment O_dat2 --params-file rig.yaml",
)
def experiment(names: tuple[str, ...], **settings: Any) -> None:  # noqa: ANN401
    """Run experiments of the thesis, a bag for each.

    The simulated arm's time follows the wall clock and waits for a machine that is late: no sample
    is lost. A board runs in real time.
    """
    entries = [experiments.experiment(name) for name in names]
    run_experiments(entries, ExperimentSettings(**settings))


@click.command()
@click.option("--all", "everything", is_flag=True, help="Run all of them; else list them.")
@_run_options
@examples("catalogue", "catalogue --all --fast -o out/experiments")
def catalogue(*, everything: bool, **settings: Any) -> None:  # noqa: ANN401
    """List the experiments of the thesis, or run all of them."""
    if everything:
        entries = list(experiments.catalogue().values())
        run_experiments(entries, ExperimentSettings(**settings))
    else:
        _show_catalogue()


def run_experiments(entries: Sequence[Experiment], settings: ExperimentSettings) -> None:
    """Run experiments one after the other and describe the bags in a manifest.

    An incomplete or refused record is kept as `NAME.partial`.

    Raises
    ------
    LaunchError
        For a repeated name, an existing bag, an unreadable manifest or an incomplete record.
    """
    folder = settings.folder.absolute()
    _make_room(folder, entries, overwrite=settings.overwrite)
    settings.pace.prepare()
    parameters = {"daq": settings.pace.parameters() | {"seed": settings.seed}}
    log = folder / "nodes.log"
    # A record is settled when the recorder has closed it: after the graph.
    with (
        ExitStack() as records,
        running_graph(
            parameters,
            log,
            nodes=_NODES,
            files=settings.parameter_files,
            namespace=settings.namespace,
        ) as (operator, _),
    ):
        for number, entry in enumerate(entries, start=1):
            words = f"{entry.input_text}, {entry.samples} samples at {entry.rate_hz:g} Hz"
            terminal.step(f"{number} of {len(entries)}: {entry.name}, {words}")
            bag = folder / entry.name
            record = records.enter_context(new_record(bag))
            commander = _prepare(operator, entry, settings)
            recorded = record_run(
                operator, commander, record, entry.samples, text="sampling", bag=bag
            )
            problems = check_bag(bag).problems
            for problem in problems:
                terminal.CONSOLE.print(f"  problem: {problem}", markup=False)
            _describe(folder, entry, recorded, problems, settings)
            _show_extent(recorded)
    count = len(entries)
    terminal.step(f"{count} bag{'s' * (count != 1)} in {settings.folder}, described in {MANIFEST}")


def _show_catalogue() -> None:
    """Print the experiments as one table."""
    table = Table("name", "kind", "length", "rate", "payload", "input", box=None, header_style="")
    for entry in experiments.catalogue().values():
        table.add_row(
            entry.name,
            experiments.KINDS[entry.kind],
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
        for file in _strange_files(bag):
            raise LaunchError(f"{file} is no part of a bag: move it away, or -o names another")
        if workplace(bag).exists():
            raise LaunchError(
                f"{workplace(bag)} is there: another run records into it, or it was left by one "
                "that was killed; check the bag in it, move or remove it"
            )
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
        raise LaunchError(f"{manifest} cannot be read ({error}): move or remove it") from error
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


def _show_extent(recorded: RecordedRun) -> None:
    """Print how far the arm and the command went."""
    data = recorded.reading.data
    largest_v = abs(data.y[:, 0]).max()
    terminal.CONSOLE.print(
        f"  position within {largest_v:.2f} V, command {abs(data.u).max():.2f} V"
    )
    bound_v = LimiterSettings().position_bound_v
    if largest_v >= bound_v:
        terminal.CONSOLE.print(
            f"  note: the arm came past {bound_v:g} V, where no command drives it further outward"
        )
