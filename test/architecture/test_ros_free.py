"""Computing modules that do without ROS, imported with it blocked."""

from __future__ import annotations

import subprocess
import sys

import pytest

from support.import_graph import SOURCES, project_modules

COMPUTING_PACKAGES = (
    "flexarm_core",
    "flexarm_bags",
    "flexarm_node",
    "flexarm_daq",
    "flexarm_ident",
    "flexarm_control",
    "flexarm_live",
)
CONNECTING = {
    *(
        f"flexarm_node.{name}"
        for name in (
            "topics.waiting",
            "codecs",
            "qos",
            "parameters",
            "process",
            "loop_node",
            "answering_node",
            "reports",
            "transport",
        )
    ),
    *(
        f"flexarm_live.graph.{name}"
        for name in ("bridge", "loop_nodes", "node_parameters", "samples")
    ),
    "flexarm_control.trajectory_action",
    "flexarm_daq.nodes.recorded_topics",
    "flexarm_daq.nodes.rig_choice",
    "flexarm_daq.nodes.topic_link",
}
"""Modules that talk to ROS, beside the nodes themselves."""

IMPORT_WITHOUT_ROS = """
import importlib, sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package in {"rclpy", "rcl_interfaces", "std_srvs", "ament_index_python"} or (
            package.endswith("_msgs")
        ):
            raise ImportError("no ROS here: " + name)
sys.meta_path.insert(0, NoRos())
sys.path[:0] = sys.argv[1].split(":")
try:
    import rclpy
except ImportError:
    pass
else:
    raise SystemExit("rclpy is not blocked")
for name in sys.argv[2:]:
    importlib.import_module(name)
"""


def computing_modules() -> list[str]:
    """Return every module that has to do without ROS."""
    names = {
        module.name
        for module in project_modules()
        if module.package in COMPUTING_PACKAGES and not module.name.endswith("_node")
    }
    return sorted(names - CONNECTING)


def run_without_ros(*modules: str) -> subprocess.CompletedProcess[str]:
    """Import modules in a process that has no ROS."""
    paths = ":".join(str(SOURCES / package) for package in COMPUTING_PACKAGES)
    return subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", IMPORT_WITHOUT_ROS, paths, *modules],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_computing_modules___are_imported_without_ros() -> None:
    modules = computing_modules()
    assert {
        "flexarm_ident.subspace.orse",
        "flexarm_daq.rigs.plant",
        "flexarm_control.laws.registry",
    } < set(modules)

    finished = run_without_ros(*modules)

    assert finished.stderr == ""
    assert finished.returncode == 0


@pytest.mark.parametrize("module", ["flexarm_node.topics.waiting", "flexarm_daq.nodes.daq_node"])
def test_connecting_module___is_what_the_block_stops(module: str) -> None:
    finished = run_without_ros(module)
    assert finished.returncode != 0
    assert "no ROS here" in finished.stderr
