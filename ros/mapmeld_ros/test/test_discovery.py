"""Which topics are robots' maps, and how to subscribe to them."""

from __future__ import annotations

import pytest
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from mapmeld_ros.discovery import MAP_TYPE, TF_TYPE, find_robots, in_namespace, with_own_tf
from mapmeld_ros.qos import requests

TOPICS = [
    ("/map", [MAP_TYPE]),
    ("/robot1/map", [MAP_TYPE]),
    ("/robot2/map", [MAP_TYPE]),
    ("/fleet/robot3/map", [MAP_TYPE]),
    ("/robot1/costmap", [MAP_TYPE]),
    ("/robot1/mymap", [MAP_TYPE]),
    ("/robot4/map", ["std_msgs/msg/String"]),
    ("/robot1/map_updates", ["map_msgs/msg/OccupancyGridUpdate"]),
]


def test_robots_are_the_namespaces_of_map_topics() -> None:
    assert find_robots(TOPICS, "map", "", {"/map"}) == {
        "fleet/robot3": "/fleet/robot3/map",
        "robot1": "/robot1/map",
        "robot2": "/robot2/map",
    }


def test_a_map_without_a_namespace_is_the_robot_slash() -> None:
    assert find_robots(TOPICS, "map", "", {"/merged"})["/"] == "/map"
    assert in_namespace("/", "map_updates") == "/map_updates"
    assert in_namespace("fleet/robot3", "map_updates") == "/fleet/robot3/map_updates"


@pytest.mark.parametrize(
    ("namespace", "robots"),
    [
        ("robot", ["fleet/robot3", "robot1", "robot2"]),
        ("fleet", ["fleet/robot3"]),
        ("robot1", ["robot1"]),
        ("x", []),
    ],
)
def test_robot_namespace_is_a_part_of_the_topic(namespace: str, robots: list[str]) -> None:
    assert list(find_robots(TOPICS, "map", namespace, {"/map"})) == robots


def test_the_map_topic_has_its_own_name_and_own_topics_are_left_out() -> None:
    assert find_robots(TOPICS, "costmap", "", set()) == {"robot1": "/robot1/costmap"}
    assert find_robots(TOPICS, "robot3/map", "", set()) == {"fleet": "/fleet/robot3/map"}
    assert find_robots(TOPICS, "costmap", "", {"/robot1/costmap"}) == {}


def test_a_robot_has_its_own_tree_when_its_namespace_has_a_tf_topic() -> None:
    topics = [
        ("/tf", [TF_TYPE]),
        ("/robot1/tf", [TF_TYPE]),
        ("/robot2/tf_static", [TF_TYPE]),
        ("/robot3/tf", ["x/msg/Y"]),
    ]
    assert with_own_tf(topics, ["/", "robot1", "robot2", "robot3", "robot4"]) == {"robot1", "robot2"}


RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE


def matches(request: tuple, offer: tuple) -> bool:
    """The rule of DDS: what is asked is no more than what is offered."""
    return (request[0] == BEST_EFFORT or offer[0] == RELIABLE) and (
        request[1] == VOLATILE or offer[1] == LATCHED
    )


@pytest.mark.parametrize("count", [1, 2, 4])
def test_every_publisher_is_matched_and_nothing_is_given_away(count: int) -> None:
    offers = [(r, d) for r in (RELIABLE, BEST_EFFORT) for d in (LATCHED, VOLATILE)]
    for first in range(len(offers)):
        present = (offers + offers)[first : first + count]
        asked = requests(present)
        for offer in present:
            assert any(matches(request, offer) for request in asked)
            # A latched map is asked for where there is one.
            assert offer in asked


def test_no_publisher_is_no_request() -> None:
    assert requests([]) == ()
