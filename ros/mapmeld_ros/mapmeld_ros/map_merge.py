"""The executable map_merge."""

from __future__ import annotations

import sys

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from mapmeld_ros.interruption import Interruption, end_soon
from mapmeld_ros.node import MapMerge

AWAKE = 0.5
"""Seconds after which an idle node looks whether it was interrupted."""


def main(args: list[str] | None = None) -> int:
    """Runs the node until it is interrupted; the exit code."""
    interruption = Interruption()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = MapMerge()
    except (ValueError, InvalidParameterTypeException, InvalidParameterValueException) as error:
        print(f"map_merge: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    # A task is something that the executor returns for; to be woken is not.
    interruption.wake = lambda: executor.create_task(lambda: None)
    try:
        while not interruption.is_requested:
            executor.spin_once(timeout_sec=AWAKE)
    except ExternalShutdownException:
        pass
    finally:
        end_soon()
        # The threads of the node end while the context is still there.
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
