#!/bin/sh
# Builds message packages with CMake and installs them into a virtual environment that has ROS 2 as wheels.
# Usage: build_interfaces.sh ENVIRONMENT PACKAGE_FOLDER...
set -eu
environment=$(cd "$1" && pwd)
wheels=$(cd "$(dirname "$0")" && pwd)
shift
PATH="$environment/bin:$PATH"
AMENT_PREFIX_PATH=$environment
CMAKE_PREFIX_PATH=$environment
export PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH
unset PYTHONPATH
for package in "$@"; do
  build=$environment/build/$(basename "$package")
  log=$build.log
  mkdir -p "$environment/build"
  # A build folder of other sources or of an older environment would be taken for this one's.
  rm -rf "$build"
  if ! { cmake -S "$package" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
           -DCMAKE_INSTALL_PREFIX="$environment" -DPython3_EXECUTABLE="$environment/bin/python" \
           -DCMAKE_PROJECT_INCLUDE="$wheels/wheels.cmake" &&
         cmake --build "$build" --target install; } >"$log" 2>&1; then
    tail -n 30 "$log" >&2
    echo "mapmeld: $package cannot be built; the whole output is in $log" >&2
    exit 1
  fi
done
