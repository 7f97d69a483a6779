"""Verbs about files and bags: import, check, repair."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ament_index_python.packages import get_package_share_directory

from flexarm_bags import repair
from flexarm_bags.check import check_bag
from flexarm_bags.schema import load_typestore
from flexarm_bringup.console import terminal
from flexarm_daq.importing.csv_import import import_csv
from flexarm_daq.importing.csv_map import load_csv_map

if TYPE_CHECKING:
    from collections.abc import Iterable

_BAG_FILES = ("metadata.yaml", "*.mcap*", "*.db3*")


def import_measurements(csv: Path, map_file: Path, bag: Path) -> str:
    """Turn a CSV file into a bag and say what came of it."""
    share = Path(get_package_share_directory("flexarm_msgs"))
    summary = import_csv(
        csv, load_csv_map(map_file), bag, typestore=load_typestore({"flexarm_msgs": share})
    )
    return (
        f"{summary.bag}: {summary.samples} samples at {summary.rate_hz:g} Hz, "
        f"{summary.duration_s:.2f} s"
    )


def check_bags(paths: Iterable[Path]) -> bool:
    """Print what is wrong with bags and what could not be checked; return whether all are good.

    Parameters
    ----------
    paths
        Bags, and folders of bags.
    """
    good = True
    for bag in (bag for path in paths for bag in _bags_of(path)):
        found = check_bag(bag)
        verdict = f"{len(found.problems)} problems" if found.problems else "good"
        terminal.CONSOLE.print(f"{bag}: {found.messages} messages, {verdict}", markup=False)
        for problem in found.problems:
            terminal.CONSOLE.print(f"  problem: {problem}", markup=False)
        for note in found.notes:
            terminal.CONSOLE.print(f"  note: {note}", markup=False)
        good = good and not found.problems
    return good


def _bags_of(path: Path) -> list[Path]:
    """Return the bags in a folder of bags; else the path itself."""
    if _has_bag_files(path):
        return [path]
    # A run that was killed leaves its record in a workplace.
    found = (folder for pattern in ("*", "*.new/*") for folder in path.glob(pattern))
    return sorted(folder for folder in found if _has_bag_files(folder)) or [path]


def _has_bag_files(folder: Path) -> bool:
    """Tell if this is a bag, be it whole or not."""
    return any(any(folder.glob(pattern)) for pattern in _BAG_FILES)


def repair_bag(damaged: Path, output: Path) -> str:
    """Copy what is whole and say how much it is."""
    summary = repair.repair_bag(damaged, output)
    damage = f" ({summary.damage})" if summary.damage else " (every message was whole)"
    return f"{summary.bag}: {summary.messages} messages{damage}"
