"""Moments of a bag's time, as a user gives them and as messages name them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from decimal import Decimal
from typing import NoReturn

from mapmeld.errors import MapmeldError
from mapmeld.map_yaml import one_line

# Seconds from which on a number without sign is a date and no duration: 1973, or a bag of three years.
_EPOCH_FROM = 10**8
# Nanoseconds have to fit in the 64 bits of a bag.
_MOST_SECONDS = 9 * 10**9


@dataclass(frozen=True)
class BagTime:
    """A moment: nanoseconds from the bag's start, or from the epoch."""

    nanoseconds: int
    from_start: bool
    text: str

    def in_bag(self, start: int) -> int:
        """Nanoseconds since the epoch of the bag's clock, for a bag that starts at `start`."""
        return start + self.nanoseconds if self.from_start else self.nanoseconds


def parse_bag_time(text: str) -> BagTime:
    """Reads seconds from the bag's start ("30", "+30"), seconds since the epoch ("1700000030.5"; from 1e8 on)
    and ISO 8601 dates with a zone ("2023-11-14T22:13:50Z"). Raises MapmeldError for anything else.
    """
    word = text.strip()
    if re.fullmatch(r"\+?([0-9]+\.?[0-9]*|\.[0-9]+)", word):
        seconds = Decimal(word)
        if seconds > _MOST_SECONDS:
            _fail(text, "is no time in seconds; give seconds, not milli- or nanoseconds")
        from_start = word.startswith("+") or seconds < _EPOCH_FROM
        return BagTime(int(seconds * 10**9), from_start, word)
    try:
        # Python 3.10 does not know the Z.
        moment = datetime.fromisoformat(re.sub(r"[zZ]$", "+00:00", word))
    except ValueError:
        _fail(
            text,
            "must be seconds from the bag's start (30), seconds since the epoch, or a date as "
            "2023-11-14T22:13:50Z",
        )
    if moment.tzinfo is None:
        _fail(text, f"has no time zone; write {moment.isoformat()}Z for UTC, or +01:00 for Z")
    whole = int(moment.replace(microsecond=0).timestamp())
    return BagTime(whole * 10**9 + moment.microsecond * 1000, False, word)


def since_start(nanoseconds: int, start: int) -> str:
    """A moment of a bag that starts at `start`, for people: "+41.200 s"."""
    return f"{(nanoseconds - start) / 1e9:+.3f} s"


def _fail(text: str, problem: str) -> NoReturn:
    raise MapmeldError(one_line(f"--at {text}: {problem}"))
