"""PyYAML's safe loaders, fit for files that strangers wrote."""

from __future__ import annotations

import re

import yaml

_SHORT = 1000
"""Characters that libyaml may have: it goes down one call a bracket and overflows the C stack on 40 kB of
"[", which kills the process, where PyYAML's own parser raises RecursionError."""


class Loader(yaml.SafeLoader):
    """PyYAML's safe loader in Python, for texts of any length."""


_SHORT_LOADER: type[Loader] | type[yaml.CSafeLoader] = Loader
if yaml.__with_libyaml__:

    class ShortLoader(yaml.CSafeLoader):
        """The same on libyaml, a tenth of the time: a folder of a thousand maps opens a second earlier."""

    _SHORT_LOADER = ShortLoader

# YAML 1.1, and so PyYAML, takes 2e-07 for a string. yaml-cpp reads and writes it as a number, and nav2's
# map_saver writes a tiny yaw so.
for _loader in {Loader, _SHORT_LOADER}:
    _loader.add_implicit_resolver(
        "tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+\Z"), list("-+0123456789")
    )


def open_loader(text: str) -> Loader | yaml.CSafeLoader:
    """A loader of a text, the fastest that stands it. Raises yaml.YAMLError, or what it makes does."""
    # libyaml takes tabs where PyYAML does not: whether a file is valid must not depend on its length.
    return _SHORT_LOADER(text) if len(text) <= _SHORT and "\t" not in text else Loader(text)
