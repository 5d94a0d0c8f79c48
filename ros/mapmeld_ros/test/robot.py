"""Publishes what robots publish, as the lines on stdin say: a JSON object each, answered by "done".

{"do": "map", "topic", "frame", "file": npz with data, resolution, origin}, and optionally "durability" and
"reliability" (of the first map on a topic), "set": {"info.resolution": NaN, ...}, fields that are set after
all others, "cells": how many cells of the data are sent.
{"do": "update", "topic", "frame", "x", "y", "file"}
{"do": "tf", "topic", "parent", "child"}
{"do": "silence", "topic"}: ends the publisher of a topic.
"""

from __future__ import annotations

import array
import json
import signal
import sys
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

from mapmeld import OccupancyGrid
from mapmeld_ros.conversions import grid_to_message


class Robots:
    def __init__(self) -> None:
        rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
        self.node = rclpy.create_node("robots")
        self.publishers: dict[str, Any] = {}

    def publisher(self, kind: type, topic: str, command: dict[str, Any]) -> Any:
        if topic not in self.publishers:
            qos = QoSProfile(
                depth=10,
                durability=DurabilityPolicy[command.get("durability", "transient_local").upper()],
                reliability=ReliabilityPolicy[command.get("reliability", "reliable").upper()],
            )
            self.publishers[topic] = self.node.create_publisher(kind, topic, qos)
        return self.publishers[topic]

    def do(self, command: dict[str, Any]) -> None:
        topic = command["topic"]
        if command["do"] == "map":
            msg = grid_to_message(
                load(command["file"]), command["frame"], self.node.get_clock().now().to_msg()
            )
            if "cells" in command:
                msg.data = msg.data[: command["cells"]]
            for path, value in command.get("set", {}).items():
                set_field(msg, path.split("."), value)
            self.publisher(OccupancyGridMsg, topic, command).publish(msg)
        elif command["do"] == "update":
            grid = load(command["file"])
            msg = OccupancyGridUpdate(x=command["x"], y=command["y"], width=grid.width, height=grid.height)
            msg.header.frame_id = command["frame"]
            msg.data = array.array("b", grid.data.tobytes())
            self.publisher(OccupancyGridUpdate, topic, command).publish(msg)
        elif command["do"] == "tf":
            link = TransformStamped(child_frame_id=command["child"])
            link.header.frame_id = command["parent"]
            # Far from where the node would put a map: it tells its own transforms by their numbers.
            link.transform.translation.x = 99.0
            publisher = self.publisher(TFMessage, topic, {"durability": "volatile", **command})
            publisher.publish(TFMessage(transforms=[link]))
        elif command["do"] == "silence":
            self.node.destroy_publisher(self.publishers.pop(topic))
        else:
            raise ValueError(command)


def load(file: str) -> OccupancyGrid:
    saved = np.load(file)
    return OccupancyGrid(saved["data"], float(saved["resolution"]), saved["origin"].tolist())


def set_field(msg: Any, path: list[str], value: Any) -> None:
    for name in path[:-1]:
        msg = getattr(msg, name)
    if path[-1] == "data":
        value = array.array("b", value)
    setattr(msg, path[-1], value)


def main() -> None:
    # The test ends this process; robots end without saying good-bye.
    signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
    robots = Robots()
    for line in sys.stdin:
        robots.do(json.loads(line))
        print("done", flush=True)


if __name__ == "__main__":
    main()
