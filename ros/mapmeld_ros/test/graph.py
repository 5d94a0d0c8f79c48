"""A ROS 2 graph for one test: a domain of its own, the node and robots in processes of their own."""

from __future__ import annotations

import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from mapmeld_msgs.msg import MergeEstimate
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from mapmeld import OccupancyGrid
from mapmeld_ros.qos import ALL_LATCHED, LATCHED

HERE = Path(__file__).parent
# Nothing here takes so long on a machine that does nothing else.
PATIENCE = 40.0


class Domain:
    """A ROS_DOMAIN_ID that no other test on this machine uses, held by a port."""

    def __init__(self) -> None:
        start = os.getpid() % 90
        for k in range(90):
            self.number = 1 + (start + k) % 90
            self._socket = socket.socket()
            try:
                self._socket.bind(("127.0.0.1", 23400 + self.number))
                return
            except OSError:
                self._socket.close()
        raise RuntimeError("all ROS domains are taken by other tests")

    def close(self) -> None:
        self._socket.close()


class Process:
    """A Python program of the graph; its output goes to a file."""

    def __init__(self, args: Sequence[str], environment: dict[str, str], log: Path) -> None:
        self.log = log
        self._file = log.open("ab")
        self.popen = subprocess.Popen(
            [sys.executable, *args],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE if args[0].endswith("robot.py") else self._file,
            stderr=self._file,
        )

    def said(self) -> str:
        return self.log.read_text()

    def stop(self, sig: int = signal.SIGINT) -> int:
        """Ends it, with force when it does not listen; its exit code."""
        if self.popen.poll() is None:
            self.popen.send_signal(sig)
        try:
            code = self.popen.wait(15)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            self.popen.wait()
            raise AssertionError(f"{self.popen.args} did not end:\n{self.said()}") from None
        finally:
            for stream in (self.popen.stdin, self.popen.stdout, self._file):
                if stream is not None:
                    stream.close()
        return code


class Fleet(Process):
    """A process that publishes what robots publish, see robot.py."""

    def do(self, **command: Any) -> None:
        """Has the process do one thing, and waits until it is done."""
        self.popen.stdin.write(json.dumps(command).encode() + b"\n")
        self.popen.stdin.flush()
        answer = self.popen.stdout.readline()
        assert answer == b"done\n", (command, answer, self.said())


class Graph:
    """What a test needs to talk to the node. Everything is collected: maps by topic, estimates,
    transforms."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.domain = Domain()
        self._count = itertools.count()
        self.environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(self.domain.number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOG_DIR": str(folder / "ros_log"),
            "RCUTILS_LOGGING_BUFFERED_STREAM": "0",
        }
        self.context = Context()
        rclpy.init(context=self.context, domain_id=self.domain.number, args=[])
        self.ros = rclpy.create_node("test", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.ros)
        self.processes: list[Process] = []
        self.maps: dict[str, list[OccupancyGridMsg]] = {}
        self.estimates: list[MergeEstimate] = []
        self.links: dict[str, list[TFMessage]] = {}
        self.ros.create_subscription(MergeEstimate, "/map_merge/estimate", self.estimates.append, LATCHED)
        self.hear_map("/map")
        self.hear_tf("/tf_static")
        self.hear_tf("/tf")

    # Hearing

    def hear_map(self, topic: str) -> None:
        self.maps[topic] = []
        self.ros.create_subscription(OccupancyGridMsg, topic, self.maps[topic].append, LATCHED)

    def hear_tf(self, topic: str) -> None:
        self.links[topic] = []
        # At a depth of one, what two publishers latched would replace each other before it is heard.
        qos = ALL_LATCHED if topic.endswith("static") else QoSProfile(depth=100)
        self.ros.create_subscription(TFMessage, topic, self.links[topic].append, qos)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def wait(self, what: str, condition: Callable[[], Any], patience: float = PATIENCE) -> Any:
        """Spins until the condition is true; its value."""
        end = time.monotonic() + patience
        while not (value := condition()):
            if time.monotonic() > end:
                logs = "\n".join(f"--- {p.log.name}\n{p.said()}" for p in self.processes)
                last = self.estimates[-1] if self.estimates else None
                raise AssertionError(f"waited in vain for {what}\nestimate: {last}\n{logs}")
            self.executor.spin_once(timeout_sec=0.05)
        return value

    def wait_status(self, **statuses: str) -> MergeEstimate:
        """Waits until the newest estimate says so of the robots; that estimate."""

        def says() -> MergeEstimate | None:
            newest = self.estimates[-1] if self.estimates else None
            is_so = newest and {r.robot: r.status for r in newest.robots}.items() >= statuses.items()
            return newest if is_so else None

        return self.wait(f"the estimate {statuses}", says)

    def wait_map(
        self, topic: str = "/map", accept: Callable[[OccupancyGridMsg], Any] = lambda _: True
    ) -> OccupancyGridMsg:
        """Waits until the topic's newest map is accepted; that map."""
        got = self.maps[topic]
        return self.wait(f"a map on {topic}", lambda: got[-1] if got and accept(got[-1]) else None)

    def tree(self, *topics: str) -> dict[str, tuple[str, tuple[float, float, float]]]:
        """Map frame to (parent, (x, y, yaw)) of the newest static transforms; each frame has one parent."""
        found: dict[str, tuple[str, tuple[float, float, float]]] = {}
        for topic in topics or ("/tf_static",):
            for t in self.links[topic][-1].transforms if self.links[topic] else ():
                assert t.child_frame_id not in found, f"{t.child_frame_id} has two parents"
                r, v = t.transform.rotation, t.transform.translation
                yaw = 2 * float(np.arctan2(r.z, r.w))
                found[t.child_frame_id] = (
                    t.header.frame_id,
                    (v.x, v.y, float(np.arctan2(np.sin(yaw), np.cos(yaw)))),
                )
        return found

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        """A service's answer."""
        client = self.ros.create_client(kind, name)
        self.wait(f"the service {name}", client.service_is_ready)
        # DDS may find the service's two topics one after the other: an answer that comes between is lost.
        for _ in range(4):
            future = client.call_async(kind.Request(**fields))
            end = time.monotonic() + 10.0
            while not future.done() and time.monotonic() < end:
                self.executor.spin_once(timeout_sec=0.05)
            if future.done():
                break
        self.ros.destroy_client(client)
        assert future.done(), f"{name} does not answer: {[p.said() for p in self.processes]}"
        return future.result()

    # Acting

    def node(self, name: str = "node", **parameters: Any) -> Process:
        """Starts map_merge; estimates come at once unless the test says otherwise."""
        values = {"estimation_rate": 50.0, "discovery_rate": 2.0, "merging_rate": 20.0, **parameters}
        file = self.folder / f"params_{next(self._count)}.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}))
        return self._start(
            Process, ["-m", "mapmeld_ros.map_merge", "--ros-args", "--params-file", str(file)], name
        )

    def program(self, args: list[str], name: str = "program") -> Process:
        """Starts a Python program."""
        return self._start(Process, args, name)

    def fleet(self, name: str = "fleet") -> Fleet:
        """Starts a process that publishes."""
        return self._start(Fleet, [str(HERE / "robot.py")], name)

    def save(self, grid: OccupancyGrid) -> str:
        """Writes a grid where a fleet can read it."""
        file = self.folder / f"grid_{next(self._count)}.npz"
        np.savez(file, data=grid.data, resolution=grid.resolution, origin=grid.origin)
        return str(file)

    def publish(self, fleet: Fleet, grid: OccupancyGrid, **options: Any) -> None:
        """Has a fleet publish a robot's map: on /<name>/map in the frame <name>/map, unless told
        otherwise."""
        topic = options.pop("topic", f"/{grid.name}/map")
        frame = options.pop("frame", f"{grid.name}/map")
        fleet.do(do="map", topic=topic, frame=frame, file=self.save(grid), **options)

    def close(self) -> None:
        codes = []
        try:
            for process in self.processes:
                if process.popen.stdin and not process.popen.stdin.closed:
                    codes.append((process.log.name, process.stop()))
        finally:
            self.executor.shutdown()
            self.ros.destroy_node()
            rclpy.shutdown(context=self.context)
            self.domain.close()
        bad = [(name, code) for name, code in codes if code not in (0,)]
        assert not bad, (bad, [p.said() for p in self.processes])
        for process in self.processes:
            assert "Traceback" not in process.said(), process.said()

    def _start(self, kind: type, args: list[str], name: str) -> Any:
        process = kind(args, self.environment, self.folder / f"{name}_{next(self._count)}.log")
        self.processes.append(process)
        return process
