"""Direction of the imports: no circle, arrows only downwards, few floors in a folder."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import pytest

from support.import_graph import (
    circle,
    folder_arrows,
    longest_chain,
    module_arrows,
    project_modules,
)

if TYPE_CHECKING:
    from support.import_graph import Arrows

MODULES = project_modules()

# Bottom first. A package imports from the rows below its own, and from no other.
STOREYS = (
    {"flexarm_msgs", "flexarm_core"},
    {"flexarm_bags", "flexarm_node"},
    {"flexarm_daq", "flexarm_ident"},
    {"flexarm_control"},
    {"flexarm_live"},
    {"flexarm_bringup"},
    {"reproduction", "flexarm_extras"},
)
STOREY = {package: number for number, row in enumerate(STOREYS) for package in row}
# The loop in memory takes any rig by its Protocol; the page draws the arm and runs the catalogue;
# viewers get what the recorder can record.
USERS_OF_THE_RIG = {
    "flexarm_control.simulation",
    "flexarm_live.graph.about",
    "flexarm_live.graph.chain",
    "flexarm_live.foxglove_node",
}
MOST_FLOORS = 8
# Of the standard library after Python 3.10, the oldest that is supported: no linter looks for them.
NEWER = {
    "asyncio.Runner", "asyncio.TaskGroup", "asyncio.timeout", "contextlib.chdir", "datetime.UTC",
    "enum.ReprEnum", "enum.StrEnum", "enum.verify", "hashlib.file_digest", "itertools.batched",
    "tomllib", "typing.LiteralString", "typing.Never", "typing.NotRequired", "typing.Required",
    "typing.Self", "typing.TypeVarTuple", "typing.Unpack", "typing.assert_never",
    "typing.assert_type", "typing.override",
}  # fmt: skip


@pytest.mark.slow
def test_modules___load_only_what_the_oldest_python_has() -> None:
    loaded = {module.name: NEWER & module.loaded for module in MODULES}
    assert {name: names for name, names in loaded.items() if names} == {}


def test_circle___of_arrows_with_one___is_found() -> None:
    arrows = {"a": frozenset("b"), "b": frozenset("c"), "c": frozenset("b")}
    assert circle(arrows) == ["b", "c", "b"]
    assert circle({"a": frozenset("bc"), "b": frozenset("c"), "c": frozenset()}) == []


def test_longest_chain___of_a_folder___counts_its_members_only() -> None:
    arrows = {"a": frozenset("bc"), "b": frozenset("c"), "c": frozenset("d"), "d": frozenset()}
    assert longest_chain(arrows, frozenset("abcd")) == ["a", "b", "c", "d"]
    assert longest_chain(arrows, frozenset("acd")) == ["a", "c", "d"]


@pytest.fixture(scope="module")
def arrows() -> Arrows:
    return module_arrows(MODULES)


@pytest.mark.slow
def test_modules___import___without_a_circle() -> None:
    assert len(MODULES) > 100
    assert circle(module_arrows(MODULES, types=True)) == []


def test_folders___import___without_a_circle() -> None:
    assert circle(folder_arrows(MODULES)) == []


def test_packages___import___only_from_storeys_below() -> None:
    upwards = sorted(
        f"{module.name} imports {name}"
        for module in MODULES
        for name in module.imported
        if (target := name.partition(".")[0]) in STOREY
        and target != module.package
        and STOREY[target] >= STOREY[module.package]
    )
    assert upwards == []


def test_rig___is_imported___by_the_command_and_the_loop_in_memory_only() -> None:
    users = {
        module.name
        for module in MODULES
        if module.package
        not in {"flexarm_daq", "flexarm_bringup", "reproduction", "flexarm_extras"}
        and any(name.partition(".")[0] == "flexarm_daq" for name in module.imported)
    }
    assert users <= USERS_OF_THE_RIG


def test_folders___have___few_floors(arrows: Arrows) -> None:
    folders = defaultdict(set)
    for module in MODULES:
        if not module.is_init:
            folders[module.folder].add(module.name)
    chains = [longest_chain(arrows, frozenset(members)) for members in folders.values()]
    assert [chain for chain in chains if len(chain) > MOST_FLOORS] == []
