#!/bin/sh
# Says what this machine lacks for ROS 2 from wheels, one line; says nothing when it has everything.
# Usage: missing.sh PYTHON, a command that should be CPython 3.11.
is_311='import sys; sys.exit(sys.version_info[:2] != (3, 11) or sys.implementation.name != "cpython")'
if [ "$(uname -s)" != Linux ]; then
  echo "ROS 2 comes as wheels for Linux only"
elif ! "${1:-python3.11}" -c "$is_311" 2>/dev/null; then
  echo "no CPython 3.11 found, for which ROS 2 comes as wheels; choose one with 'make PYTHON311=path/to/python3.11'"
elif ! command -v c++ >/dev/null; then
  echo "no C++ compiler found (c++), which message packages need"
fi
