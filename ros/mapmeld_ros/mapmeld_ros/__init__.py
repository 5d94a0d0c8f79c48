"""The map merge as a ROS 2 node: converts messages, calls Mapmeld, publishes. No algorithm lives here."""
