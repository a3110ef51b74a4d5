"""What is asked of a log: which sensors its verdict speaks for, and up to which size of an error."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from gtmbench.checks import meant, number
from gtmbench.errors import InputError
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS, unit_of

LIMIT_DEG_S, LIMIT_DEG = 5.0, 10.0  # of an error that stays; asked by our users, see docs/explanation/verdict.md
JUDGED = 0.75  # of the time in motion: less is no verdict on a flight
GROUPS = {
    "gyros": GYROS,
    "attitude": ATTITUDE,
    "surfaces": COMMANDS,
}  # what is asked by one word; "all" is every sensor that anything compares
_LIMIT = re.compile(r"\s*(?P<value>[-+.\w]+?)\s*(?P<unit>deg/s|deg)?\s*")


@dataclass(frozen=True, kw_only=True)
class Scope:
    """What is asked of a log.

    Attributes
    ----------
    sensors : tuple of str
        Those that the verdict speaks for.
    error_deg_s, error_deg : float
        The largest error that stays which may hide in a span that is called clear, of a gyro and of an angle.
    factor : float or None
        A factor that has to show, below or above 1; None where factors are only told.
    judged : float
        The least share of the time in motion.

    Examples
    --------
    >>> scope = Scope(sensors=("q", "theta"))
    >>> scope.limit_of("q"), scope.limit_of("theta"), scope.limit_of("tas")
    (5.0, 10.0, inf)
    """

    sensors: tuple[str, ...]
    error_deg_s: float = LIMIT_DEG_S
    error_deg: float = LIMIT_DEG
    factor: float | None = None
    judged: float = JUDGED

    def limit_of(self, sensor: str) -> float:
        """Return the largest error of a sensor that may stay unseen, in its unit; infinite where nothing is asked."""
        own, _, _ = sensor.partition(" of ")  # an IMU
        return {"deg/s": self.error_deg_s, "deg": self.error_deg}.get(unit_of(own), math.inf)

    def with_limits(self, limits: Iterable[str]) -> Scope:
        """Return the scope with limits as they are typed: ``2deg/s``, ``8deg``, ``factor=0.7``; ``3`` is of gyros.

        Raises
        ------
        InputError
            Where one isn't a positive, finite size.

        Examples
        --------
        >>> Scope(sensors=("p",)).with_limits(["2deg/s", "factor=0.7"]).factor
        0.7
        """
        scope = self
        for text in limits:
            scope = scope._with_limit(text)
        return scope

    def _with_limit(self, text: str) -> Scope:
        name, is_named, value = text.partition("=")
        if is_named and name.strip() == "factor":
            factor = number("--limit factor", _number(text, value), 0.0, 100.0, above=True)
            if factor == 1.0:
                raise InputError("--limit factor=1 is no fault; give a factor below or above 1, such as factor=0.7")
            return replace(self, factor=factor)
        given = _LIMIT.fullmatch(text)
        if given is None or is_named:
            raise InputError(f"--limit is '{text}'; give 5deg/s, 10deg or factor=0.7")
        size = number("--limit", _number(text, given["value"]), 0.0, 1e4, above=True)
        return replace(self, error_deg=size) if given["unit"] == "deg" else replace(self, error_deg_s=size)


def _number(text: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise InputError(f"--limit is '{text}'; give 5deg/s, 10deg or factor=0.7") from None


def judge_text(given: str | Sequence[str] | None) -> str | None:
    """Return which sensors are asked as one text, as ``--judge`` takes it; None for the usual ones.

    >>> judge_text(["p", "q"]), judge_text("gyros"), judge_text(None)
    ('p,q', 'gyros', None)
    """
    return given if given is None or isinstance(given, str) else ",".join(given)


def asked_sensors(
    given: str | Sequence[str] | None, there: Sequence[str], usual: Sequence[str], held: Sequence[str]
) -> tuple[str, ...]:
    """Return which sensors are asked.

    Parameters
    ----------
    given : str, sequence of str or None
        ``p,q,r``, ``gyros``, ``attitude``, ``all``, or names; None for the usual ones.
    there : sequence of str
        The sensors of the log.
    usual : sequence of str
        Those that are asked where nobody says.
    held : sequence of str
        Those that anything compares, further IMUs' among them: all that ``all`` can ask for.

    Raises
    ------
    InputError
        Where the log has no such sensor, or none is named.

    Examples
    --------
    >>> log = {"there": ["p", "q", "r", "tas", "beta"], "usual": ["p"], "held": ["p", "q", "r", "tas"]}
    >>> asked_sensors("gyros", **log), asked_sensors("all", **log), asked_sensors("beta", **log)
    (('p', 'q', 'r'), ('p', 'q', 'r', 'tas'), ('beta',))
    """
    if given is None:
        return tuple(name for name in usual if name in there or name in held)
    names = given.split(",") if isinstance(given, str) else list(given)
    asked: list[str] = []
    for name in (each.strip() for each in names):
        if name == "all":
            asked += held
        elif name in GROUPS:
            asked += [each for each in GROUPS[name] if each in there or each in held]
        elif name in there or name in held:
            asked.append(name)
        else:
            known = ", ".join(dict.fromkeys([*there, *held, *GROUPS, "all"]))
            raise InputError(f"--judge: no sensor '{name}' in this log{meant(name, there)}; there are {known}")
    if not asked:
        raise InputError("--judge names no sensor of this log; give p,q,r, gyros or all")
    return tuple(dict.fromkeys(asked))
