# The ROS 2 node on real ROS 2 without a distribution: wheels for CPython 3.11 in a virtual environment of their own,
# .venv-ros, the message packages built into it, and Mapmeld with the core that .venv has.
PYTHON311 ?= python3.11
ROS_VENV := .venv-ros
ROS_PY := $(ROS_VENV)/bin/python
ROS_INTERFACES := ros/test_interfaces/tf2_msgs ros/test_interfaces/map_msgs ros/mapmeld_msgs
ROS_INTERFACE_FILES := $(foreach p,$(ROS_INTERFACES),$(wildcard $(p)/msg/* $(p)/srv/* $(p)/package.xml $(p)/CMakeLists.txt))

.PHONY: ros ros-check ros-test ros-bench ros-robots test-ros

ros: $(ROS_VENV)/.ready

$(ROS_VENV)/.wheels: ros/wheels/requirements.txt ros/wheels/dependencies.py pyproject.toml
	@problem="$$(ros/wheels/missing.sh $(PYTHON311))"; [ -z "$$problem" ] || { echo "mapmeld: $$problem" >&2; exit 1; }
	rm -rf $(ROS_VENV)
	$(PYTHON311) -m venv $(ROS_VENV)
	$(ROS_PY) ros/wheels/dependencies.py pyproject.toml > $(ROS_VENV)/mapmeld.txt
	$(ROS_PY) -m pip install --quiet -r ros/wheels/requirements.txt -r $(ROS_VENV)/mapmeld.txt
	@touch $@

$(ROS_VENV)/.interfaces: $(ROS_VENV)/.wheels $(ROS_INTERFACE_FILES) ros/wheels/wheels.cmake ros/wheels/build_interfaces.sh
	ros/wheels/build_interfaces.sh $(ROS_VENV) $(ROS_INTERFACES)
	@touch $@

# The core is built for the stable ABI of Python, so this environment uses the one that lies in python/mapmeld.
$(ROS_VENV)/.ready: $(VENV)/.built $(ROS_VENV)/.interfaces
	printf '%s\n' "$(CURDIR)/python" "$(CURDIR)/ros/mapmeld_ros" > $(ROS_VENV)/lib/python3.11/site-packages/mapmeld.pth
	@touch $@

# Types of the node; ruff is run by `make check`.
ros-check: $(ROS_VENV)/.ready
	MYPYPATH=ros/mapmeld_ros:python $(VENV)/bin/mypy --config-file ros/mapmeld_ros/mypy.ini --python-executable $(ROS_PY)

# Three at a time: these tests mostly wait for processes, and each has a ROS domain of its own. A test that fails is run
# once more, alone, as ROS retests what goes over DDS: where the lease of a process that was killed runs out while another
# one leaves, two threads of Fast DDS 3.2 can wait for each other, in the process of the test.
ROS_PYTEST = $(ROS_PY) -m pytest -c ros/mapmeld_ros/pytest.ini -o addopts="-q --strict-markers" \
	-o cache_dir=$(CURDIR)/$(ROS_VENV)/.pytest_cache
ros-test: $(ROS_VENV)/.ready
	$(ROS_PYTEST) -n 3 ros/mapmeld_ros/test || { [ $$? -eq 1 ] && \
	  $(ROS_PYTEST) --last-failed --last-failed-no-failures none -n 1 ros/mapmeld_ros/test; }

ros-bench: $(ROS_VENV)/.ready
	$(ROS_PY) ros/mapmeld_ros/benchmark/latency.py

ros-robots: $(ROS_VENV)/.ready
	$(ROS_PY) ros/mapmeld_ros/benchmark/ten_robots.py

# What `make test` does: runs them where it can, and says so where it cannot.
test-ros:
	@problem="$$(ros/wheels/missing.sh $(PYTHON311))"; \
	if [ -n "$$problem" ]; then \
	  echo "********************************************************************************" >&2; \
	  echo "mapmeld: THE TESTS OF THE ROS 2 NODE ARE SKIPPED: $$problem" >&2; \
	  echo "********************************************************************************" >&2; \
	else \
	  $(MAKE) --no-print-directory ros-check ros-test; \
	fi
