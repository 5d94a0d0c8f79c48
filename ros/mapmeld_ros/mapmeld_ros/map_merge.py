"""The executable map_merge."""

from __future__ import annotations

import signal
import sys

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation

from mapmeld_ros.node import MapMerge

RCLError = rclpy_implementation.RCLError
AWAKE = 0.5
"""Seconds after which an idle node looks whether it was interrupted."""


def main(args: list[str] | None = None) -> int:
    """Runs the node until it is interrupted; the exit code."""
    # rclpy's own handler ends the context, which ends the executor. Python's would raise KeyboardInterrupt
    # besides, in whatever runs: in the making of a message it comes out as an error that says nothing of it.
    signal.signal(signal.SIGINT, lambda *_: None)
    rclpy.init(args=args)
    try:
        node = MapMerge()
    except (ValueError, InvalidParameterTypeException, InvalidParameterValueException) as error:
        print(f"map_merge: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        # A signal that comes just before the executor waits wakes nobody, and an idle node has no timer.
        while rclpy.ok():
            executor.spin_once(timeout_sec=AWAKE)
    except ExternalShutdownException:
        pass
    except RCLError:
        # The context ended while the executor was about to wait.
        if rclpy.ok():
            raise
    finally:
        executor.shutdown()
        node.destroy_node()
        # The process ends: taking the signal handlers away would race with a signal that still comes.
        rclpy.try_shutdown(uninstall_handlers=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
