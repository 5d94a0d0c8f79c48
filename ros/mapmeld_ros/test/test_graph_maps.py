"""Maps as robots really send them: growing, moving their origins, turned, in parts, and broken."""

from __future__ import annotations

import math

import numpy as np
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg

import rooms
from graph import Fleet, Graph
from mapmeld import OccupancyGrid, se2
from mapmeld_ros.conversions import grid_from_message


def part(grid: OccupancyGrid, rows: slice, cols: slice) -> OccupancyGrid:
    """A window of a grid, as SLAM has it while it has seen no more: smaller, with an origin of its own."""
    data = grid.data[rows, cols]
    x = grid.origin[0] + grid.resolution * (cols.start or 0)
    y = grid.origin[1] + grid.resolution * (rows.start or 0)
    return OccupancyGrid(data, grid.resolution, (x, y, 0.0), grid.name)


def walls(msg: OccupancyGridMsg) -> np.ndarray:
    """World coordinates of a map's walls."""
    grid = grid_from_message(msg, "")
    return grid.cell_centers(*np.nonzero(grid.data == 100))


def sends(graph: Graph, fleet: Fleet, grid: OccupancyGrid, wall_cells: int) -> OccupancyGridMsg:
    """Publishes one robot's map and waits until the merged map has that many wall cells."""
    graph.publish(fleet, grid)
    return graph.wait_map(accept=lambda m: np.count_nonzero(np.array(m.data) == 100) == wall_cells)


def test_the_world_stays_where_it_is_while_a_map_grows_shrinks_and_moves_its_origin(graph: Graph) -> None:
    """slam_toolbox's maps: the origin moves when there is more to the left or below."""
    whole = rooms.view("left", (-0.5, 9.0), (0.0, 0.0, 0.0))
    fleet = graph.fleet()
    graph.node()
    windows = [
        (slice(20, 70), slice(30, 70)),
        (slice(20, 80), slice(30, 90)),
        (slice(5, 80), slice(10, 90)),
        (slice(20, 60), slice(40, 70)),
        (slice(0, 86), slice(0, 95)),
    ]
    corner: tuple[float, float] | None = None
    for window in windows:
        sent = part(whole, *window)
        msg = sends(graph, fleet, sent, np.count_nonzero(sent.data == 100))
        assert msg.header.frame_id == "world"
        # Every wall is where the first map's frame has it.
        expected = sent.cell_centers(*np.nonzero(sent.data == 100))
        np.testing.assert_allclose(sorted(walls(msg).tolist()), sorted(expected.tolist()), atol=1e-6)
        # The lattice is the same, and what was covered stays covered.
        origin = (msg.info.origin.position.x, msg.info.origin.position.y)
        if corner is not None:
            cells = (np.array(origin) - corner) / sent.resolution
            np.testing.assert_allclose(cells, np.rint(cells), atol=1e-6)
            assert (cells <= 1e-6).all()
        corner = origin


def test_a_map_with_a_turned_origin_lies_where_tf_puts_it(graph: Graph) -> None:
    """The same walls, once with a plain origin and once in a grid that is turned by 0.4 rad: one place."""
    straight = rooms.view("left", (-0.5, 9.0), (0.0, 0.0, 0.0))
    # The grid's axes are turned by 0.4 in the map frame, so the same walls have other cells.
    turned = rooms.view("left", (-0.5, 9.0), (0.0, 0.0, 0.4))
    x, y = se2.apply((0.0, 0.0, 0.4), np.array(turned.origin[:2]))
    turned = OccupancyGrid(turned.data, turned.resolution, (float(x), float(y), 0.4), "left")
    fleet = graph.fleet()
    graph.node()
    before = walls(sends(graph, fleet, straight, np.count_nonzero(straight.data == 100)))
    seen = len(graph.maps["/map"])
    graph.publish(fleet, turned)
    graph.wait("the turned map", lambda: len(graph.maps["/map"]) > seen)
    after = walls(graph.maps["/map"][-1])
    nearest = np.array([np.hypot(*(before - p).T).min() for p in after])
    assert np.quantile(nearest, 0.99) < 0.15
    assert abs(len(after) - len(before)) < 0.2 * len(before)


def test_maps_of_different_resolutions_merge(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node()
    for name, resolution in (("left", 0.1), ("middle", 0.05)):
        x_range = {"left": (-0.5, 9.0), "middle": (2.0, 12.0)}[name]
        graph.publish(fleet, rooms.view(name, x_range, rooms.TRUTH[name], resolution))
    graph.wait_status(left="merged", middle="merged")
    graph.wait("both transforms", lambda: len(graph.tree()) == 2)
    poses = {frame: np.array(pose) for frame, (_, pose) in graph.tree().items()}
    metres, radians = rooms.relative_error(poses["left/map"], poses["middle/map"], "left", "middle")
    assert metres < 0.1
    assert radians < 0.02
    # The finest resolution, and both maps.
    graph.wait_map(accept=lambda m: m.info.resolution < 0.06 and m.info.width * m.info.resolution > 11)


def test_updates_change_a_part_of_the_map(graph: Graph) -> None:
    fleet = graph.fleet()
    graph.node()
    hall = rooms.hall("r")
    before = np.count_nonzero(hall.data == 100)
    sends(graph, fleet, hall, before)
    wall = OccupancyGrid(np.full((2, 5), 100), hall.resolution)
    fleet.do(do="update", topic="/r/map_updates", frame="r/map", x=3, y=20, file=graph.save(wall))
    # The publisher is new to the node, which hears it from the next look on.
    graph.spin(1.0)
    fleet.do(do="update", topic="/r/map_updates", frame="r/map", x=3, y=20, file=graph.save(wall))
    msg = graph.wait_map(accept=lambda m: np.count_nonzero(np.array(m.data) == 100) == before + 10)
    expected = hall.cell_centers(np.array([20]), np.array([3]))
    assert np.hypot(*(walls(msg) - expected).T).min() < 1e-6


BROKEN = {
    "data": {"cells": 100},
    "info.resolution": {"set": {"info.resolution": 0.0}},
    "info.resolution: nan": {"set": {"info.resolution": math.nan}},
    "info.origin.position.x": {"set": {"info.origin.position.x": math.nan}},
    "info.origin.orientation": {"set": {"info.origin.orientation.w": 3.0}},
    "info.width": {"set": {"info.width": 0, "info.height": 0, "data": []}},
    "data: values": {"set": {"data": [101] * (30 * 45)}},
    "data: values -2": {"set": {"data": [-2] * (30 * 45)}},
    "header.frame_id": {"set": {"header.frame_id": "elsewhere"}},
    "info.width: 20000 x 20000": {"set": {"info.width": 20000, "info.height": 20000}},
}


def test_broken_messages_are_named_once_and_the_last_good_map_stays(graph: Graph) -> None:
    fleet = graph.fleet()
    node = graph.node()
    hall = rooms.hall("r")
    count = np.count_nonzero(hall.data == 100)
    sends(graph, fleet, hall, count)
    graph.spin(0.5)
    published = len(graph.maps["/map"])
    for field, change in BROKEN.items():
        for _ in range(3):
            graph.publish(fleet, hall, **change)
        name = field.split(":")[0]
        graph.wait(
            f"a warning of {name}", lambda name=name: f"robot 'r': map not used: {name}: " in node.said()
        )
    graph.spin(0.5)
    said = node.said()
    # Each field is warned of once, however often it comes.
    fields = {field.split(":")[0] for field in BROKEN}
    for field in fields:
        assert said.count(f"map not used: {field}: ") == 1, said
    assert len(graph.maps["/map"]) == published
    (robot,) = graph.estimates[-1].robots
    assert robot.has_pose
    # And a good one is taken again.
    more = np.array(hall.data)
    more[3, 5:10] = 100
    sends(graph, fleet, OccupancyGrid(more, hall.resolution, hall.origin, "r"), count + 5)


def test_two_publishers_that_offer_different_things_are_both_heard(graph: Graph) -> None:
    """A saved map that is latched, and a live one that is not, on one topic: no silent mismatch."""
    latched, live = graph.fleet("latched"), graph.fleet("live")
    hall = rooms.hall("r")
    graph.publish(latched, hall, durability="transient_local")
    graph.node()
    graph.wait_map()
    more = np.array(hall.data)
    more[3, 5:10] = 100
    grown = OccupancyGrid(more, hall.resolution, hall.origin, "r")
    graph.publish(live, grown, durability="volatile")
    # The first message is lost with a volatile publisher that nobody has matched yet.
    graph.spin(1.5)
    graph.publish(live, grown)
    graph.wait_map(
        accept=lambda m: np.count_nonzero(np.array(m.data) == 100) == np.count_nonzero(more == 100)
    )


def test_a_large_map_is_merged(graph: Graph) -> None:
    """16 million cells, nearly all unknown, as SLAM packages reserve them."""
    data = np.full((4000, 4000), -1, dtype=np.int8)
    left = rooms.building()[0]
    row, col = 1500, 2100
    data[row : row + left.height, col : col + left.width] = left.data
    x, y, _ = left.origin
    corner = (x - col * left.resolution, y - row * left.resolution, 0.0)
    large = OccupancyGrid(data, left.resolution, corner, "left")
    fleet = graph.fleet()
    graph.node()
    graph.publish(fleet, large)
    graph.publish(fleet, rooms.building()[1])
    graph.wait_status(left="merged", middle="merged")
    # What nobody has seen is not published.
    msg = graph.wait_map(accept=lambda m: m.info.width * m.info.resolution > 11)
    assert msg.info.width * msg.info.height < 100_000
