"""The whole graph on a ROS 2 installation: `ros2 launch flexarm_bringup laboratory.launch.py`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Start daq, controller, recorder and ident; `bag:=FOLDER` records from the start."""
    parameters = PathJoinSubstitution(
        [FindPackageShare("flexarm_bringup"), "config", "laboratory.yaml"]
    )
    recording = {"bag": LaunchConfiguration("bag")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=parameters),
            DeclareLaunchArgument("bag", default_value="''"),
            *(
                Node(
                    package=package,
                    executable=f"{name}_node",
                    output="screen",
                    parameters=[LaunchConfiguration("params_file"), *extra],
                )
                for package, name, extra in (
                    ("flexarm_daq", "recorder", [recording]),
                    ("flexarm_ident", "ident", []),
                    ("flexarm_control", "controller", []),
                    ("flexarm_daq", "daq", []),
                )
            ),
        ]
    )
