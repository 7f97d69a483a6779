"""Verb bench: flexarm measured beside its peers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE, RUN_ON, examples
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.checkout.folder import checkout, environment


@click.group()
def bench() -> None:
    """Measure flexarm beside its peers."""


_BENCHES = {
    "ident": "CPU time, memory and accuracy of the identification beside its peers",
    "ident_bound": "Coloured noise: the methods beside the best that is possible",
    "real": "Measured records of a folder: the default beside ARX, SLICOT and SIPPY",
    "holes": "Models of records with lost samples beside the undamaged ones",
    "reduction": "Modal reduction on simulated C_dat3 and C_dat11",
    "rig": "Speed of the simulated rig in times real time",
    "bags": "Speed of reading bags beside rosbags",
    "verbs": "What a user waits for on the command line",
    "loop": "The control loop over DDS beside C and a bare Python loop",
    "live": "The live page: its cost to the loop, its drawing, STOP, verbs of another terminal",
    "foxglove": "Samples of a running arm that reach a viewer of the Foxglove protocol",
    "payload": "Payload detection, and gains that follow it",
    "control": "Trials of the laws, their cost, and the tuning time",
    "shapers": "Reference shapers: residual vibration and settling time of each",
    "laws": "All laws on payloads, set-points and rigs that differ from their design",
    "learning": "Learning of a command by repetition: what is left of the first run's differences",
    "robustness": "Tuned gains over a grid of payloads and on rigs drawn at random",
    "servo": "design --track on random arms in MuJoCo: steps beside those of the true model",
    "mujoco": "The simulated rig beside the same arm in MuJoCo",
    "tip": "Control of the tip of an arm in MuJoCo beside control of its hub",
    "calibration": "Parameters of the study's rig beside the thesis's figures of all chapters",
    "faults": "The fault campaign: broken rigs, killed processes",
    "schedules": "Seeded schedules of faults: the whole graph in virtual time, invariants checked",
    "mutants": "Small defects planted in the code: which the tests notice",
    "bag_faults": "Cut, flipped and mutated bags",
    "page_film": "Moving picture of the live page, from a real run",
    "report_picture": "Picture of the top of a report",
    "endurance": "Ten minutes of recording with a busy core, or hours of memory",
}
"""What each file of the folder `bench` measures."""


_SPEED = {
    "verbs": (),
    "bags": ("--seconds", "600"),
    "rig": (),
    "ident": ("--seeds", "1"),
    "loop": ("--rate", "300", "--rate", "1000"),
}
"""What `bench all` runs, and its options."""


@bench.command("all")
@click.option(
    "--json",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the figures, one file for each.",
)
@FORCE
@examples("bench all", "bench all --json out/bench")
def every(folder: Path | None, *, force: bool) -> None:
    """Measure the speed of this machine, in some ten minutes.

    The benches of speed run one after the other: leave the machine alone for that while.
    """
    root, failed = checkout("benchmarks"), []
    for name, settings in _SPEED.items():
        kept = () if folder is None else ("--json", str(folder / f"{name}.json"))
        again = ("--force",) if force else ()
        terminal.step(f"bench {' '.join((name, *settings))}")
        if _measure(root, name, (*settings, *kept, *again)):
            failed.append(name)
    if failed:
        raise LaunchError(f"these benches failed, as they say above: {', '.join(failed)}")


def _measure(root: Path, name: str, arguments: tuple[str, ...]) -> int:
    """Run a bench, and return its exit code."""
    (file,) = root.glob(f"bench/*/{name}.py")
    command = [sys.executable, "-m", f"bench.{file.parent.name}.{name}", *arguments]
    done = subprocess.run(command, check=False, env=environment(root))  # noqa: S603 - our own
    return done.returncode


def _add_bench(name: str, words: str) -> None:
    @bench.command(
        name, help=words, short_help=words, add_help_option=False, context_settings=RUN_ON
    )
    @click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
    def measure(arguments: tuple[str, ...]) -> None:
        sys.exit(_measure(checkout("benchmarks"), name, arguments))


for _bench in _BENCHES.items():
    _add_bench(*_bench)
