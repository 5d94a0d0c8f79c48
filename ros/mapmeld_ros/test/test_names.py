"""Numbers and frames of components, and the transforms between frames."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from tf2_msgs.msg import TFMessage

from mapmeld import Estimate
from mapmeld.estimate import EstimatedComponent
from mapmeld_ros.components import ComponentNames, frame_of, topic_of
from mapmeld_ros.conversions import transform_message
from mapmeld_ros.transforms import Others, link, plan


def estimate(*components: tuple[str, ...], world: str = "a") -> Estimate:
    """Components whose first robot is the anchor."""
    found = tuple(EstimatedComponent(tuple(sorted(c)), c[0], world in c, None) for c in components)
    return Estimate((), found, None, 0, 0.0)


def test_the_largest_is_first_and_the_others_keep_their_numbers() -> None:
    names = ComponentNames("world")
    assert [n.number for n in names.name(estimate(("a", "b"), ("c",), ("d",)))] == [1, 2, 3]
    # c joins the first; d keeps its topic.
    assert [n.number for n in names.name(estimate(("a", "b", "c"), ("d",)))] == [1, 3]
    # e is new and takes what is free.
    assert [n.number for n in names.name(estimate(("a", "b", "c"), ("e",), ("d",)))] == [1, 2, 3]


def test_a_component_that_becomes_the_largest_moves_to_the_first_topic() -> None:
    names = ComponentNames("world")
    names.name(estimate(("a",), ("b",), ("c",)))
    found = names.name(estimate(("b", "c"), ("a",)))
    assert [(n.number, n.frame) for n in found] == [(1, "world_b"), (2, "world")]


def test_frames_are_the_world_or_called_after_the_anchor() -> None:
    assert frame_of("world", "robot1", True) == "world"
    assert frame_of("world", "fleet/robot1", False) == "world_fleet_robot1"
    assert frame_of("map", "/", False) == "map_root"
    assert [topic_of("map", n) for n in (1, 2)] == ["map", "map_2"]


def test_every_frame_gets_one_parent() -> None:
    links = [
        link("a", "world", "map", (0, 0, 0), False),
        link("b", "world", "map", (1, 0, 0), False),
        link("c", "world", "c/map", (2, 0, 0), False),
        link("d", "world", "", (3, 0, 0), False),
        link("e", "world_e", "world", (0, 0, 0), False),
    ]
    found = plan(links, "tf_static", ["world", "world_e"], Others())
    assert {t: [one.robot for one in some] for t, some in found.topics.items()} == {"/tf_static": ["a", "c"]}
    assert set(found.problems) == {"b", "d", "e"}
    assert "'a'" in found.problems["b"]
    assert "frame_id" in found.problems["d"]
    assert "world_frame" in found.problems["e"]


def test_robots_with_trees_of_their_own_may_share_a_frame_name() -> None:
    links = [link(name, "world", "map", (0, 0, 0), True) for name in ("a", "b")]
    found = plan(links, "tf", ["world"], Others())
    assert sorted(found.topics) == ["/a/tf", "/b/tf"]
    assert found.problems == {}


def test_no_two_components_share_a_frame() -> None:
    names = ComponentNames("world")
    found = names.name(estimate(("a/b",), ("a_b",), world=""))
    assert [n.frame for n in found] == ["world_a_b", "world_a_b_2"]
    # And each keeps its own.
    assert [n.frame for n in names.name(estimate(("a_b",), ("a/b",), world=""))] == [
        "world_a_b_2",
        "world_a_b",
    ]


def static(parent: str, child: str, x: float = 0.0) -> TFMessage:
    return TFMessage(transforms=[transform_message((x, 0.0, 0.0), parent, child, Time())])


def test_own_transforms_are_known_again_and_do_not_pile_up() -> None:
    others = Others()
    for x in range(1000):
        others.publish(static("world", "a/map", x))
    # The newest, and what may wait in the queue.
    assert not others.hear(static("world", "a/map", 999))
    assert not others.hear(static("world", "a/map", 950))
    assert len(others._own) == len(others._recent) < 200


def test_what_is_not_heard_again_is_forgotten() -> None:
    others = Others()
    assert others.hear(static("world", "a/map"))
    assert others.hear(static("base", "b/map"))
    others.listen_again()
    # Until then both stand.
    assert others.parent_of("a/map") == "world"
    assert not others.hear(static("base", "b/map"))
    assert others.forget()
    assert (others.parent_of("a/map"), others.parent_of("b/map")) == (None, "base")
    assert not others.forget()


def test_leading_slashes_of_frames_are_dropped() -> None:
    assert link("a", "world", "/a/map", (0, 0, 0), False).map_frame == "a/map"
