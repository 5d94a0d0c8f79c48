"""What the command line is told of maps: --session, --prior, --pin, --points, --forbid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mapmeld.known import Known
    from mapmeld.session_file import Session

PRIOR_HELP = "Pose of a map in the world and its standard deviations, metres and radians; may be repeated."
PIN_HELP = "Pose of a map in the world that is exact, metres and radians; may be repeated."
POINTS_HELP = "Places that maps A and B both show, x and y in each, metres; may be repeated."
FORBID_HELP = "Two maps whose match is wrong; may be repeated."
SESSION_HELP = "A session.json, as `mapmeld studio` saves it: its pins, points and options count."


def read_session_option(path: Path | None) -> Session | None:
    """The session at the path, if one is given."""
    if path is None:
        return None
    from mapmeld.session_file import read_session

    return read_session(path)


def gather_known(
    session: Session | None,
    priors: Sequence[str] | None,
    pins: Sequence[str] | None,
    points: Sequence[str] | None,
    forbidden: Sequence[str] | None,
) -> Known | None:
    """What the options say, on top of the session; None without either. Raises MapmeldError, naming the
    option."""
    if session is None and not (priors or pins or points or forbidden):
        return None
    from mapmeld.errors import MapmeldError
    from mapmeld.estimate import Prior
    from mapmeld.known import Known, SamePoints
    from mapmeld.map_yaml import one_line

    base = Known() if session is None else session.known
    told_priors, told_pins = dict(base.priors), dict(base.pins)
    same, pairs = list(base.same_points), list(base.forbidden)
    placed: dict[str, str] = {}
    for text in priors or []:
        name, n = _numbers("--prior", text, "NAME=X,Y,THETA,SX,SY,STHETA", lambda k: k == 6)
        _once(placed, name, f"--prior {text}")
        if min(n[3:]) <= 0:
            raise MapmeldError(
                one_line(f"--prior {text}: SX, SY and STHETA must be positive; --pin a pose that is exact")
            )
        told_priors[name] = Prior(n[:3], n[3:])
        # What the command line says of a map stands in the place of what the session does.
        told_pins.pop(name, None)
    for text in pins or []:
        name, n = _numbers("--pin", text, "NAME=X,Y,THETA", lambda k: k == 3)
        _once(placed, name, f"--pin {text}")
        told_pins[name] = (n[0], n[1], n[2])
        told_priors.pop(name, None)
    for text in points or []:
        form = "A,B=XA,YA,XB,YB,..."
        both, n = _numbers("--points", text, form, lambda k: k > 0 and k % 4 == 0)
        a, b = _two("--points", both, form)
        four = [n[k : k + 4] for k in range(0, len(n), 4)]
        same.append(SamePoints(a, b, tuple(((x, y), (u, v)) for x, y, u, v in four)))
    pairs += [_two("--forbid", text, "A,B") for text in forbidden or []]
    return Known(told_priors, told_pins, tuple(same), tuple(pairs))


def _once(placed: dict[str, str], name: str, option: str) -> None:
    """Two poses of one map would leave it open which of them counts."""
    from mapmeld.errors import MapmeldError
    from mapmeld.map_yaml import one_line

    if name in placed:
        raise MapmeldError(one_line(f"{option}: {placed[name]} gives that map a pose as well; keep one"))
    placed[name] = option


def _numbers(flag: str, text: str, form: str, fits: Any) -> tuple[str, list[float]]:
    from mapmeld.errors import MapmeldError
    from mapmeld.map_yaml import one_line

    name, sign, values = text.rpartition("=")
    try:
        numbers = [float(v) for v in values.split(",")]
    except ValueError:
        numbers = []
    if not name or not sign or not fits(len(numbers)) or not all(map(math.isfinite, numbers)):
        raise MapmeldError(one_line(f"{flag} {text}: must be {form}"))
    return name, numbers


def _two(flag: str, text: str, form: str) -> tuple[str, str]:
    from mapmeld.errors import MapmeldError
    from mapmeld.map_yaml import one_line

    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise MapmeldError(one_line(f"{flag} {text}: must be {form}, names of two maps"))
    return names[0], names[1]
