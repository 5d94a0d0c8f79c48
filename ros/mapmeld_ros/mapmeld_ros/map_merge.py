"""The executable map_merge."""

from __future__ import annotations

import sys

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from mapmeld_ros.interruption import Interruption
from mapmeld_ros.node import MapMerge


def main(args: list[str] | None = None) -> int:
    """Runs the node until it is interrupted; the exit code."""
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    # A task is something that the executor returns for; to be woken is not.
    interruption = Interruption(lambda: executor.create_task(lambda: None))
    try:
        node = MapMerge()
    except (ValueError, InvalidParameterTypeException, InvalidParameterValueException) as error:
        print(f"map_merge: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    executor.add_node(node)
    while not interruption.is_requested:
        executor.spin_once()
    # The threads of the node end while the context is still there.
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
