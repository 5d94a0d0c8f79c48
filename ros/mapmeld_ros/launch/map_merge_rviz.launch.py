"""Starts the map merge and RViz with the merged map, the robots' maps and the tree.

ros2 launch mapmeld_ros map_merge_rviz.launch.py params_file:=my.yaml
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    share = Path(get_package_share_directory("mapmeld_ros"))
    names = ["namespace", "use_sim_time", "params_file"]
    defaults = ["/", "false", str(share / "config" / "map_merge.yaml")]
    declared = [DeclareLaunchArgument(n, default_value=v) for n, v in zip(names, defaults)]  # noqa: B905
    merge = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(share / "launch" / "map_merge.launch.py")),
        launch_arguments={name: LaunchConfiguration(name) for name in names}.items(),
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", str(share / "rviz" / "map_merge.rviz")],
        parameters=[{"use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)}],
    )
    return LaunchDescription([*declared, merge, rviz])
