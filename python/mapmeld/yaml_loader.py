"""PyYAML's safe loader, fit for files that strangers wrote."""

from __future__ import annotations

import re

import yaml


class Loader(yaml.SafeLoader):
    """PyYAML's safe loader in Python. libyaml's overflows the C stack on 40 kB of "[" and kills the process,
    where this one raises RecursionError; it would save less than half a millisecond a map."""


# YAML 1.1, and so PyYAML, takes 2e-07 for a string. yaml-cpp reads and writes it as a number, and nav2's
# map_saver writes a tiny yaw so.
Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+\Z"), list("-+0123456789")
)
