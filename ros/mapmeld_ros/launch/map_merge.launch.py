"""Starts the map merge.

ros2 launch mapmeld_ros map_merge.launch.py
ros2 launch mapmeld_ros map_merge.launch.py namespace:=/fleet use_sim_time:=true params_file:=my.yaml
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

ARGUMENTS = {
    "namespace": ("", "Namespace of the node; its merged map is <namespace>/map."),
    "use_sim_time": ("false", "Whether stamps come from /clock; goes before what params_file says."),
    "params_file": ("", "YAML file of parameters; without one, the package's config/map_merge.yaml."),
    "log_level": ("info", "debug, info, warn, error or fatal."),
}


def generate_launch_description() -> LaunchDescription:
    config = str(Path(get_package_share_directory("mapmeld_ros")) / "config" / "map_merge.yaml")
    defaults = {name: value for name, (value, _) in ARGUMENTS.items()} | {"params_file": config}
    declared = [
        DeclareLaunchArgument(name, default_value=defaults[name], description=description)
        for name, (_, description) in ARGUMENTS.items()
    ]
    use_sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    node = Node(
        package="mapmeld_ros",
        executable="map_merge",
        name="map_merge",
        namespace=LaunchConfiguration("namespace"),
        # Transforms go to the global tree: without a remapping /tf stays /tf, whatever the namespace.
        parameters=[LaunchConfiguration("params_file"), {"use_sim_time": use_sim_time}],
        arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level")],
        output="screen",
    )
    return LaunchDescription([*declared, node])
