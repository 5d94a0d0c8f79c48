"""--at, as people write it."""

from __future__ import annotations

import pytest

from mapmeld.bag_time import parse_bag_time, since_start
from mapmeld.errors import MapmeldError

SECOND = 10**9
EPOCH = 1_700_000_030


@pytest.mark.parametrize(
    ("text", "nanoseconds", "from_start"),
    [
        ("30", 30 * SECOND, True),
        ("+30", 30 * SECOND, True),
        ("0", 0, True),
        (" 0.25 ", SECOND // 4, True),
        (".5", SECOND // 2, True),
        ("+1700000030", EPOCH * SECOND, True),
        ("1700000030", EPOCH * SECOND, False),
        ("1700000030.123456789", EPOCH * SECOND + 123456789, False),
        ("2023-11-14T22:13:50Z", EPOCH * SECOND, False),
        ("2023-11-14T22:13:50z", EPOCH * SECOND, False),
        ("2023-11-14 23:13:50+01:00", EPOCH * SECOND, False),
        ("2023-11-14T22:13:50.250000+00:00", EPOCH * SECOND + SECOND // 4, False),
    ],
)
def test_times(text: str, nanoseconds: int, from_start: bool) -> None:
    time = parse_bag_time(text)
    assert (time.nanoseconds, time.from_start) == (nanoseconds, from_start)
    assert time.in_bag(5 * SECOND) == nanoseconds + (5 * SECOND if from_start else 0)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("soon", "seconds from the bag's start"),
        ("", "seconds from the bag's start"),
        ("-5", "seconds from the bag's start"),
        ("nan", "seconds from the bag's start"),
        ("1e3", "seconds from the bag's start"),
        ("2023-11-14T22:13:50", "2023-11-14T22:13:50Z for UTC"),
        ("2023-11-14", "zone"),
        ("2023-13-14T22:13:50Z", "seconds from the bag's start"),
        ("1700000030000", "not milli"),
        ("1700000030000000000", "not milli"),
    ],
)
def test_what_is_no_time(text: str, word: str) -> None:
    with pytest.raises(MapmeldError) as caught:
        parse_bag_time(text)
    assert str(caught.value).startswith(f"--at {text}")
    assert word in str(caught.value)


def test_for_people() -> None:
    assert since_start(EPOCH * SECOND + 41_200_000_000, EPOCH * SECOND) == "+41.200 s"
