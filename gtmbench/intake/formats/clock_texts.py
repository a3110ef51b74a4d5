"""Dates, times of day and durations as text, in the ways that loggers, spreadsheets and pandas write them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.formats.raw import RawSeries, date_text
from gtmbench.intake.units import unit

_MOSTLY = 0.9  # of the cells of a column
_FIRST = 20  # cells by which a column is known
_DAY_NS, _HOUR_NS, _MINUTE_NS, _S_NS = (round(1e9 * s) for s in (86400, 3600, 60, 1))  # by definition
_HALF_NS = 12 * _HOUR_NS  # of clocks with AM and PM
_PARTS_NS = {"hour": _HOUR_NS, "minute": _MINUTE_NS, "second": _S_NS, "ms": 1_000_000, "us": 1000}  # by definition
_EPOCH = date(1970, 1, 1).toordinal()  # days
_DATE = (
    r"(?=\d{4}|\d{1,2}[-./]\d{1,2}[-./]\d\d)(?P<one>\d{1,4})(?P<mark>[-./])(?P<two>\d{1,2})(?P=mark)(?P<three>\d{1,4})"
)
_CLOCK = r"(?P<h>\d{1,3}):(?P<m>\d{1,2})(?::(?P<s>\d{1,2}))?(?P<f>[.,:]\d{1,9})?"
_TEXT = re.compile(
    rf"(?:(?P<days>-?\d+) days?,?\s*\+?|{_DATE}(?:[T,/\s]\s*|$))?"
    rf"(?:{_CLOCK}(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?)?"
    r"(?:\s*(?:(?P<utc>Z|UTC|GMT)|(?P<zone>[+-]\d\d):?(?P<zone_m>\d\d)?))?"
)
_WITHOUT_MARKS = re.compile(r"(\d{4})(\d\d)(\d\d)[T _-](\d\d)(\d\d)(\d\d)(?!\d)")  # ISO's basic format
_COUNTED = re.compile(r"(?P<count>[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?)\s*(?P<unit>[a-z]+)")  # MATLAB's "0.02 sec"


class ClockKind(StrEnum):
    """What a column of such texts tells."""

    STAMP = "date and time"
    DAY = "date"
    CLOCK = "time of day"
    DURATION = "duration"


@dataclass(frozen=True, kw_only=True, eq=False)
class ClockTexts:
    """What a column of texts tells."""

    told: ClockKind
    nanoseconds: NDArray[np.int64]  # since 1970, since midnight, or since the beginning
    there: NDArray[np.bool_]  # which cells could be read
    is_utc: bool = False  # whether a zone stands beside them, which is taken off
    doubt: str = ""  # what else the texts may mean; "" for nothing

    @property
    def seconds(self) -> NDArray[np.float64]:
        """Seconds since the first cell, of a duration since its own beginning; NaN where none could be read."""
        first = self.nanoseconds[self.there][0] if self.told is not ClockKind.DURATION else 0
        return np.where(self.there, (self.nanoseconds - first) / 1e9, np.nan)

    @property
    def since_s(self) -> float:
        """When a date's first cell is, in seconds since 1970; 0 of others."""
        return float(self.nanoseconds[self.there][0]) / 1e9 if self.told in (ClockKind.STAMP, ClockKind.DAY) else 0.0

    @property
    def note(self) -> str:
        """What a reader of the log should know."""
        if self.told is ClockKind.DURATION:
            return "durations"
        first = np.datetime64(int(self.nanoseconds[self.there][0]), "ns")
        of_day = bool(self.doubt) or self.told is ClockKind.CLOCK  # the date is open, or there is none
        said = date_text(first, is_utc=self.is_utc)[11 * of_day :]
        return f"{self.told}: times are since the first, {said}{f'; {self.doubt}' if self.doubt else ''}"

    def on(self, days: ClockTexts) -> ClockTexts:
        """Return times of day on the dates of another column: that of the first cell, as midnights are counted here."""
        first = int(days.nanoseconds[days.there][0])
        doubt = days.doubt or self.doubt
        return replace(self, told=ClockKind.STAMP, nanoseconds=self.nanoseconds + first, doubt=doubt)

    def series(self, name: str) -> RawSeries:
        """Return the column of a log that it is, in seconds."""
        load = partial(np.asarray, self.seconds)
        return RawSeries(name=name, load=load, unit="s", since_s=self.since_s, told=self.note)


def clock_texts(cells: Sequence[Any]) -> ClockTexts | None:
    """Return what a column of texts tells; None where most of them are none of these.

    >>> clock_texts(["04.05.2026 23:59:59,5", "05.05.2026 00:00:00,5"]).seconds
    array([0., 1.])
    >>> clock_texts(["12:59:59.5 PM", "01:00:00.5 PM"]).seconds
    array([0., 1.])
    >>> clock_texts(["0 days 00:00:00.020000", "0 days 00:00:00.040000"]).told, clock_texts(["on", "off"])
    (<ClockKind.DURATION: 'duration'>, None)
    """
    texts = ["" if cell is None or cell != cell else str(cell).strip() for cell in cells]
    if any(map(_WITHOUT_MARKS.match, texts[:_FIRST])):
        texts = [_WITHOUT_MARKS.sub(r"\1-\2-\3 \4:\5:\6", text, count=1) for text in texts]
    first = [text for text in texts if text][:_FIRST]
    if not first or sum(_is_clock(text) or _is_counted(text) for text in first) < _MOSTLY * len(first):
        return None
    return _counted(texts) if _is_counted(first[0]) else _read(texts)


def clock_of_parts(parts: Mapping[str, NDArray[np.float64]]) -> ClockTexts:
    """Return the time of day that hours, minutes and seconds in columns of their own tell, with what is beyond these.

    >>> of = {"hour": np.array([23, 0]), "minute": np.array([59, 0]), "second": np.array([59.5, 0.5])}
    >>> clock_of_parts(of).seconds
    array([0., 1.])
    """
    nanoseconds = sum((np.nan_to_num(values) * _PARTS_NS[name] for name, values in parts.items()), np.zeros(1))
    there = np.all([np.isfinite(values) for values in parts.values()], axis=0)
    clocks = np.rint(nanoseconds).astype(np.int64)
    clocks[there] = _beyond_midnight(clocks[there], _DAY_NS)
    return ClockTexts(told=ClockKind.CLOCK, nanoseconds=clocks, there=there)


def clock_of_dates(dates: NDArray[Any], *, is_utc: bool) -> ClockTexts | None:
    """Return what dates tell, NaT where one is missing; None without any.

    >>> clock_of_dates(np.array(["NaT", "1970-01-02", "1970-01-03"], dtype="datetime64[ns]"), is_utc=False).seconds
    array([   nan,     0., 86400.])
    """
    there = ~np.isnat(dates)
    told = _mostly(ClockKind.STAMP, dates.astype("datetime64[ns]").astype(np.int64), there, there.tolist())
    return told and replace(told, is_utc=is_utc)


def clock_of_durations(nanoseconds: NDArray[np.int64], there: NDArray[np.bool_]) -> ClockTexts | None:
    """Return what durations tell; None without any."""
    return _mostly(ClockKind.DURATION, nanoseconds, there, there.tolist())


def _is_clock(text: str) -> bool:
    found = _TEXT.fullmatch(text)
    return found is not None and (found["mark"] is not None or _has_seconds(found))


def _has_seconds(found: re.Match[str]) -> bool:
    """Tell whether a time of day has seconds: minutes alone are no stamps of a log."""
    return found["h"] is not None and (found["s"] or found["f"]) is not None


def _is_counted(text: str) -> bool:
    found = _COUNTED.fullmatch(text)
    known = unit(found["unit"]) if found else None
    return known is not None and known.dimension == "time"


def _counted(texts: Sequence[str]) -> ClockTexts | None:
    seconds = []
    for text in texts:
        found = _COUNTED.fullmatch(text)
        known = unit(found["unit"]) if found else None
        seconds.append(float(found["count"]) / known.factor if found and known else np.nan)
    values = np.array(seconds)
    there = np.isfinite(values)
    return _mostly(ClockKind.DURATION, np.rint(np.nan_to_num(values) * 1e9).astype(np.int64), there, texts)


def _mostly(
    told: ClockKind, nanoseconds: NDArray[np.int64], there: NDArray[np.bool_], cells: Iterable[object]
) -> ClockTexts | None:
    filled = sum(map(bool, cells))
    if not there.any() or np.count_nonzero(there) < _MOSTLY * filled:
        return None
    return ClockTexts(told=told, nanoseconds=nanoseconds, there=there)


def _read(texts: Sequence[str]) -> ClockTexts | None:
    found = [_TEXT.fullmatch(text) if text else None for text in texts]
    there = np.array([each is not None and (bool(each["mark"]) or _has_seconds(each)) for each in found])
    known = [each for each, is_there in zip(found, there, strict=True) if each is not None and is_there]
    if not known:
        return None
    clocks = np.zeros(len(found), dtype=np.int64)
    clocks[there] = [_of_day(each) for each in known]
    if known[0]["mark"] is None:
        is_duration = known[0]["days"] is not None
        clocks[there] = clocks[there] if is_duration else _run_on(clocks[there], known)
        told, doubt = ClockKind.DURATION if is_duration else ClockKind.CLOCK, ""
    else:
        days, doubt = _days(known)
        clocks[there] += days
        told = ClockKind.STAMP if any(each["h"] is not None for each in known) else ClockKind.DAY
    read = _mostly(told, clocks, there, texts)
    return read and replace(read, is_utc=bool(known[0]["utc"] or known[0]["zone"]), doubt=doubt)


def _of_day(found: re.Match[str]) -> int:
    """Return the nanoseconds of a clock, and of the days before it; with its zone taken off."""
    if found["h"] is None:
        return 0
    hours, minutes, seconds = int(found["h"]), int(found["m"]), found["s"]
    if seconds is None:  # minutes, seconds and what is beyond, as Excel shows them
        hours, minutes, seconds = 0, hours, found["m"]
    if found["half"]:
        hours = hours % 12 + (12 if found["half"] in "Pp" else 0)
    beyond = found["f"][1:] if found["f"] else "0"
    zone = 0
    if found["zone"]:
        zone = int(found["zone"]) * _HOUR_NS
        zone += (1 if zone >= 0 else -1) * int(found["zone_m"] or 0) * _MINUTE_NS
    clock = hours * _HOUR_NS + minutes * _MINUTE_NS + int(seconds) * _S_NS + int(beyond.ljust(9, "0"))
    return int(found["days"] or 0) * _DAY_NS + clock - zone


def _run_on(clocks: NDArray[np.int64], known: Sequence[re.Match[str]]) -> NDArray[np.int64]:
    """Return times of day that run on beyond midnight; beyond noon where a clock of 12 hours has no halves."""
    period = _DAY_NS
    if known[0]["s"] is None:
        period = _HOUR_NS
    elif not any(each["half"] for each in known) and max(int(each["h"]) for each in known) <= 12:
        back = np.diff(clocks).min(initial=0)
        period = _HALF_NS if -_HALF_NS <= back < -_HALF_NS // 2 else period
    return _beyond_midnight(clocks, period)


def _beyond_midnight(clocks: NDArray[np.int64], period: int) -> NDArray[np.int64]:
    over = np.diff(clocks) < -(period // 2)
    turns = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(over, dtype=np.int64)])
    return np.asarray(clocks + period * turns, dtype=np.int64)


def _days(known: Sequence[re.Match[str]]) -> tuple[NDArray[np.int64], str]:
    """Return the days of dates in nanoseconds since 1970, and what else they may be."""
    mark = known[0]["mark"]
    parts = [(int(each["one"]), int(each["two"]), int(each["three"])) for each in known]
    orders = {"y m d": (0, 1, 2)} if len(known[0]["one"]) > 2 else {"d m y": (2, 1, 0), "m d y": (2, 0, 1)}
    if len(orders) > 1 and (mark == "." or any(one > 12 for one, _, _ in parts)):
        orders = {"d m y": orders["d m y"]}
    if len(orders) > 1 and any(two > 12 for _, two, _ in parts):
        orders = {"m d y": orders["m d y"]}
    read: dict[tuple[int, int, int], dict[str, int]] = {}
    made = {}
    for name, order in orders.items():
        for part in {*parts}:
            read.setdefault(part, {})[name] = _day(*(part[place] for place in order))
        days = np.array([read[part][name] for part in parts], dtype=np.int64)
        made[name] = days * _DAY_NS
    # of two orders the one by which the log is shorter: a midnight is a day, not a month
    name = min(made, key=lambda each: int(np.ptp(made[each])))
    doubtful = len(made) > 1 and np.ptp(made["d m y"]) == np.ptp(made["m d y"]) and made["d m y"][0] != made["m d y"][0]
    return made[name], "which is its day and which its month isn't known" if doubtful else ""


def _day(year: int, month: int, day: int) -> int:
    try:
        return date(year + (2000 if year < 100 else 0), month, day).toordinal() - _EPOCH
    except ValueError:
        return 0
