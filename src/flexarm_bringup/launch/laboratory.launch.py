"""The nodes of one arm: `ros2 launch flexarm_bringup laboratory.launch.py namespace:=arm2`.

A set-point for it:
`ros2 service call /arm2/set_reference flexarm_msgs/srv/SetReference "{reference_v: 3.0}"`
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

if TYPE_CHECKING:
    from launch.launch_context import LaunchContext

_PUBLISHER = "robot_state_publisher"
_NODES = (
    ("flexarm_daq", "recorder"),
    ("flexarm_ident", "ident"),
    ("flexarm_control", "controller"),
    ("flexarm_daq", "daq"),
)
_SETTINGS = {
    "rate_hz": ("daq", float, "sampling rate, Hz"),
    "rig": ("daq", str, "simulated or nidaq"),
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
            *(
                DeclareLaunchArgument(
                    name, default_value="", description=description + _AS_IN_FILES
                )
                for name, (_, _, description) in _SETTINGS.items()
            ),
            OpaqueFunction(function=_nodes),
        ]
    )


def _nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes; what was given as an argument comes after the parameter files."""
    own = PathJoinSubstitution([FindPackageShare("flexarm_bringup"), "config", "laboratory.yaml"])
    files = [own, *filter(None, [LaunchConfiguration("params_file").perform(context)])]
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (_, kind, _) in _SETTINGS.items()
        if LaunchConfiguration(name).perform(context)
    }
    namespace = _namespace(context)
    laboratory = [
        Node(
            package=package,
            executable=f"{node}_node",
            name=node,
            namespace=namespace,
            # Where SROS2 keeps its keys: config/sros2 has a policy for each.
            ros_arguments=["--enclave", f"{namespace}/{node}"],
            output="screen",
            parameters=[
                *files,
                *({name: given[name]} for name in given if _SETTINGS[name][0] == node),
            ],
        )
        for package, node in _NODES
    ]
    return laboratory + _frames(namespace)


def _namespace(context: LaunchContext) -> str:
    """Return the full namespace of the arm: one that is given is below the one pushed."""
    given = LaunchConfiguration("namespace").perform(context)
    pushed = LaunchConfiguration("ros_namespace", default="").perform(context)
    return given if given.startswith("/") else f"{pushed.rstrip('/')}/{given}"


def _frames(namespace: str) -> list[Node]:
    """Return the node that makes tf frames of the joint states, where it is installed."""
    try:
        get_package_prefix(_PUBLISHER)
    except PackageNotFoundError:
        return []
    urdf = Path(get_package_share_directory("flexarm_bringup"), "urdf", "flexarm.urdf")
    return [
        Node(
            package=_PUBLISHER,
            executable=_PUBLISHER,
            name=_PUBLISHER,
            namespace=namespace,
            output="screen",
            parameters=[
                {
                    "robot_description": ParameterValue(urdf.read_text("utf-8"), value_type=str),
                    "frame_prefix": f"{namespace.lstrip('/')}/",
                }
            ],
        )
    ]
