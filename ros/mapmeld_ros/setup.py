from glob import glob

from setuptools import setup

package_name = "mapmeld_ros"

setup(
    name=package_name,
    version="0.1.0",
    packages=[package_name],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
        (f"share/{package_name}/launch", glob("launch/*.launch.py")),
        (f"share/{package_name}/config", glob("config/*.yaml")),
        (f"share/{package_name}/rviz", glob("rviz/*.rviz")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="Mapmeld maintainers",
    maintainer_email="maintainers@mapmeld.invalid",
    description="Merges the maps of several robots while they drive.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["map_merge = mapmeld_ros.map_merge:main"],
        # A Python component container makes the node with its own context and arguments.
        "rclpy_components": ["mapmeld_ros::MapMerge = mapmeld_ros.node:MapMerge"],
    },
)
