"""The exceptions that Mapmeld raises on bad input.

"These maps do not overlap" and "two answers fit" are values of a result, never errors.
"""

from __future__ import annotations


class MapmeldError(ValueError):
    """Bad input. The message is one line: what is wrong, where, and what to do."""


class MapFileError(MapmeldError):
    """A map file that cannot be used; names the file and, where there is one, the field."""


class ConfigError(MapmeldError):
    """A configuration value or key that cannot be used; names the key."""
