"""Starts the map merge and RViz with the merged map and the tree.

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
    declared = [
        DeclareLaunchArgument("namespace", default_value="", description="Of the merge and of RViz."),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="Of the merge and of RViz."),
    ]
    # Its other arguments, params_file and log_level, are passed on as they are given.
    merge = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(share / "launch" / "map_merge.launch.py")),
        launch_arguments={n: LaunchConfiguration(n) for n in ("namespace", "use_sim_time")}.items(),
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        namespace=LaunchConfiguration("namespace"),
        # The configuration names global topics, the merge publishes in its namespace.
        remappings=[("/map", "map"), ("/map_2", "map_2")],
        arguments=["-d", str(share / "rviz" / "map_merge.rviz")],
        parameters=[{"use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)}],
    )
    return LaunchDescription([*declared, merge, rviz])
