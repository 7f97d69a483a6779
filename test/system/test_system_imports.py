from __future__ import annotations

import subprocess
import sys

import pytest

from support.project import PROJECT

pytestmark = pytest.mark.system

SOURCES = PROJECT / "src"
COMPUTING_PACKAGES = (
    "flexarm_core",
    "flexarm_bags",
    "flexarm_node",
    "flexarm_daq",
    "flexarm_ident",
    "flexarm_control",
)
CONNECTING = {
    *(
        f"flexarm_node.{name}"
        for name in (
            "waiting",
            "qos",
            "parameters",
            "process",
            "loop_node",
            "answering_node",
            "transport",
        )
    ),
    "flexarm_daq.nodes.rig_choice",
    "flexarm_daq.nodes.topic_link",
}
"""What talks to ROS beside the nodes themselves."""

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
        ".".join(file.relative_to(SOURCES / package).with_suffix("").parts)
        for package in COMPUTING_PACKAGES
        for file in (SOURCES / package / package).rglob("*.py")
        if not file.stem.endswith("_node") and file.stem != "__init__"
    }
    return sorted(names - CONNECTING)


def test_computing_modules___are_imported_without_ros() -> None:
    modules = computing_modules()
    assert {
        "flexarm_ident.subspace.orse",
        "flexarm_daq.rigs.plant",
        "flexarm_control.laws.registry",
    } < set(modules)
    paths = ":".join(str(SOURCES / package) for package in COMPUTING_PACKAGES)

    finished = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", IMPORT_WITHOUT_ROS, paths, *modules],
        capture_output=True,
        text=True,
        check=False,
    )

    assert finished.stderr == ""
    assert finished.returncode == 0


@pytest.mark.parametrize("module", ["flexarm_node.waiting", "flexarm_daq.nodes.daq_node"])
def test_connecting_module___is_what_the_block_stops(module: str) -> None:
    paths = ":".join(str(SOURCES / package) for package in COMPUTING_PACKAGES)
    finished = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", IMPORT_WITHOUT_ROS, paths, module],
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode != 0
    assert "no ROS here" in finished.stderr
