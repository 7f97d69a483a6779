"""The nodes of one arm: `ros2 launch flexarm_bringup laboratory.launch.py namespace:=arm2`.

A set-point for it:
`ros2 service call /arm2/set_reference flexarm_msgs/srv/SetReference "{reference_v: 3.0}"`
"""

from __future__ import annotations

from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, Any

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from flexarm_node.parameter_files import LOOP, is_simulated
from launch import LaunchDescription

if TYPE_CHECKING:
    from launch.launch_context import LaunchContext

_PUBLISHER = "robot_state_publisher"
_VIEWER = "rviz2"
_NODES = (
    ("flexarm_daq", "recorder"),
    ("flexarm_ident", "ident"),
    ("flexarm_control", "controller"),
    ("flexarm_daq", "daq"),
)
_ON_REQUEST = {
    "page": (("flexarm_daq", "experiment"), ("flexarm_live", "live")),
    "foxglove": (("flexarm_live", "foxglove"),),
}
"""Nodes by the argument that starts them when it is true; a page runs experiments in open loop."""
_SETTINGS = {
    "rate_hz": ("daq", float, "sampling rate, Hz"),
    "rig": ("daq", str, "simulated, nidaq, or the file of a rig description"),
    "law": ("controller", str, "control law, such as pd or pdpc"),
    "bag": ("recorder", str, "folder of a bag, to be created: record from the start"),
}
"""Arguments that set the parameter of the same name: its node, type and description."""
_AS_IN_FILES = " (default: as the parameter files say)"


def generate_launch_description() -> LaunchDescription:
    """Start daq, controller, recorder and ident."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace",
                # That of PushRosNamespace around an include of this file.
                default_value=LaunchConfiguration("ros_namespace", default="flexarm"),
                description="namespace of the arm: one for each of several",
            ),
            DeclareLaunchArgument(
                "params_file",
                default_value="",
                description="parameter file that comes after flexarm_bringup/config/laboratory.yaml"
                "; a section for /**/daq is for the node daq in any namespace",
            ),
            DeclareLaunchArgument(
                "page",
                default_value="false",
                description="true: serve the page of the arm; `flexarm status` prints its address",
            ),
            DeclareLaunchArgument(
                "foxglove",
                default_value="false",
                description="true: serve the topics to Foxglove, Lichtblick, PlotJuggler",
            ),
            DeclareLaunchArgument(
                "compose",
                default_value="",
                description="true: daq and controller in one process; false: in two; default: in "
                "one for a simulated arm, in two for a board",
            ),
            DeclareLaunchArgument(
                "real_time",
                default_value="false",
                description="true: hard real time for a simulated rig too, as with a board",
            ),
            DeclareLaunchArgument(
                "clock",
                default_value="",
                description="topic in the place of /clock, such as /arm2/clock for a second arm in "
                "virtual time",
            ),
            DeclareLaunchArgument(
                "view", default_value="false", description="true: show the arm in RViz"
            ),
            *(
                DeclareLaunchArgument(
                    name, default_value="", description=description + _AS_IN_FILES
                )
                for name, (_, _, description) in _SETTINGS.items()
            ),
            OpaqueFunction(function=_nodes),
        ]
    )


def _nodes(context: LaunchContext) -> list[Node | LogInfo]:
    """Return the nodes; what was given as an argument comes after the parameter files."""
    own = PathJoinSubstitution([FindPackageShare("flexarm_bringup"), "config", "laboratory.yaml"])
    files = [own, *filter(None, [LaunchConfiguration("params_file").perform(context)])]
    given: dict[str, dict[str, Any]] = {node: {} for _, node in _NODES}
    for name, (node, kind, _) in _SETTINGS.items():
        if LaunchConfiguration(name).perform(context):
            given[node][name] = ParameterValue(LaunchConfiguration(name), value_type=kind)
    if _is_wanted(context, "real_time"):
        given["daq"]["time"] = "real"
    composed = _is_composed(context, files[1:])
    clock = LaunchConfiguration("clock").perform(context)
    namespace = _namespace(context)
    urdf = PathJoinSubstitution([FindPackageShare("flexarm_bringup"), "urdf", "flexarm.urdf"])
    wanted = [
        node for name, nodes in _ON_REQUEST.items() if _is_wanted(context, name) for node in nodes
    ]
    given["foxglove"] = {"urdf": ParameterValue(urdf, value_type=str)}

    def made(package: str, node: str, name: str | None, **settings: list[Any]) -> Node:
        return Node(
            package=package,
            executable=f"{node}_node",
            name=name,
            namespace=namespace,
            # Where SROS2 keeps its keys: config/sros2 has a policy for each.
            ros_arguments=["--enclave", f"{namespace.rstrip('/')}/{node}"],
            output="screen",
            remappings=[("/clock", clock)] if clock else [],
            **settings,
        )

    laboratory = [
        made(package, node, node, parameters=[*files, *_each(given.get(node, {}))])
        for package, node in (*_NODES, *wanted)
        if not (composed and node in LOOP)
    ]
    if composed:
        # Two nodes: each parameter names its own, and the names of the nodes stay.
        words = [
            f"{node}.{name}:={_word(context, name, value)}"
            for node in LOOP
            for name, value in given[node].items()
        ]
        laboratory.append(made("flexarm_bringup", "loop", None, arguments=words, parameters=files))
    view = _view(namespace) if _is_wanted(context, "view") else []
    return [*laboratory, *_frames(namespace), *view]


def _each(parameters: dict[str, Any]) -> list[dict[str, Any]]:
    return [{name: value} for name, value in parameters.items()]


def _word(context: LaunchContext, name: str, value: object) -> str:
    """Return a parameter's value as a word of the command line, where a number keeps its type."""
    if name not in _SETTINGS:
        return str(value)
    return str(_SETTINGS[name][1](LaunchConfiguration(name).perform(context)))


def _is_wanted(context: LaunchContext, name: str) -> bool:
    """Return whether an argument that is true or false is true."""
    return LaunchConfiguration(name).perform(context).lower() == "true"


def _is_composed(context: LaunchContext, files: list[str]) -> bool:
    """Return whether law and drive share a process, as `flexarm up` has it."""
    if LaunchConfiguration("compose").perform(context):
        return _is_wanted(context, "compose")
    rig = LaunchConfiguration("rig").perform(context)
    return is_simulated(rig, [Path(each) for each in files], f"{_namespace(context)}/daq")


def _namespace(context: LaunchContext) -> str:
    """Return the full namespace of the arm: one that is given is below the one pushed."""
    given = LaunchConfiguration("namespace").perform(context)
    pushed = LaunchConfiguration("ros_namespace", default="").perform(context)
    return given if given.startswith("/") else f"{pushed.rstrip('/')}/{given}"


def _frames(namespace: str) -> list[Node]:
    """Return the node that makes tf frames of the joint states, where it is installed."""
    if not _is_installed(_PUBLISHER):
        return []
    description = ParameterValue(_shared("urdf", "flexarm.urdf"), value_type=str)
    prefix = f"{namespace}/".lstrip("/")
    return [
        Node(
            package=_PUBLISHER,
            executable=_PUBLISHER,
            name=_PUBLISHER,
            namespace=namespace,
            output="screen",
            parameters=[{"robot_description": description, "frame_prefix": prefix}],
        )
    ]


def _view(namespace: str) -> list[Node | LogInfo]:
    """Return the viewer with the frames of this arm, or what is missing for it."""
    missing = [package for package in (_PUBLISHER, _VIEWER) if not _is_installed(package)]
    if missing:
        return [LogInfo(msg=f"view:=true needs {' and '.join(missing)}: not installed here")]
    settings = _shared("config", "flexarm.rviz").replace("flexarm", namespace.lstrip("/"))
    with NamedTemporaryFile("w", suffix=".rviz", delete=False) as file:
        file.write(settings)
    return [
        Node(
            package=_VIEWER,
            executable=_VIEWER,
            name=_VIEWER,
            namespace=namespace,
            output="screen",
            arguments=["-d", file.name],
        )
    ]


def _is_installed(package: str) -> bool:
    """Return whether a package is there."""
    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        return False
    return True


def _shared(folder: str, name: str) -> str:
    """Return the text of a file of this package."""
    share = get_package_share_directory("flexarm_bringup")
    return Path(share, folder, name).read_text("utf-8")
