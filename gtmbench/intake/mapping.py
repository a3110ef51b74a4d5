"""Which column becomes which channel: by what the user states, else by documentation, else by name and unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from gtmbench.checks import listed, meant
from gtmbench.errors import InputError
from gtmbench.intake.flight_log import Source
from gtmbench.intake.formats.dialects import documented
from gtmbench.intake.formats.raw import IntArray, Meaning, RawLog, RawSeries
from gtmbench.intake.frames import forces_by_gravity, in_frame
from gtmbench.intake.names import NameGuess, guess, is_table_header, known_as, stated_unit, unit_option
from gtmbench.intake.open_columns import NOTHING, Found, found
from gtmbench.intake.stamps import Clock
from gtmbench.intake.units import Unit, dimension_of, hint, unit
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, CHANNELS, GYROS, limit_of
from gtmbench.values.clock import FloatArray
from gtmbench.values.pieces import pieces
from gtmbench.values.ranges import OutOfRange, out_of_range
from gtmbench.values.record import BoolArray

Value = TypeVar("Value")
AS_IT_IS = "as it is"
NONE = "none"  # for a column: the log counts as without the channel
UNITS = "units"  # beside the channels of a mapping: of all columns that state none
_MOST_NAMED = 40  # columns in a message
_LATEST_S = 60.0  # that a column may be stamped late
_NAMELESS = "no header: columns are called by their numbers, as in --map time=1:s --map p=2:rad/s"
_HALF_TURN_DEG, _TURN_DEG = 180.0, 360.0  # by definition


@dataclass(frozen=True, kw_only=True, eq=False)
class ChosenColumn:
    """A channel: a column of the log, what its values are multiplied by, and how late its stamps are."""

    channel: str
    series: RawSeries
    factor: float = 1.0
    how: str = ""
    meaning: Meaning | None = None

    @property
    def late_s(self) -> float:
        """By how many seconds its stamps are late."""
        return 0.0 if self.meaning is None else self.meaning.late_s

    @cached_property
    def _runs_from_zero(self) -> bool:
        """Whether it is a bank or a pitch that is counted from 0 to 360 deg, as some loggers do."""
        if self.channel not in ATTITUDE[:2]:
            return False
        values = self.series.values() * abs(self.factor)
        return bool(
            np.nanmin(values, initial=0.0) >= 0.0 and _HALF_TURN_DEG < np.nanmax(values, initial=0.0) <= _TURN_DEG
        )

    @property
    def source(self) -> Source:
        """Which column it is, and how it is read."""
        meaning = self.meaning or Meaning(channel=self.channel, unit="")
        return Source(
            channel=self.channel,
            column=self.series.name,
            unit=meaning.unit,
            sign=meaning.sign,
            late_s=meaning.late_s,
            guessed=meaning.guessed,
        )

    def readings(self) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return the channel in its unit, psi unwrapped, NaN where it is out of range; those rows; what is there."""
        values, turns = self.series.stored(), Turns()
        rows, outside = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
        for piece in pieces(len(values)):
            own, read = self.bring(values[piece], turns)
            rows.append(own + piece.start)
            outside.append(read)
        return values, np.concatenate(rows), np.concatenate(outside)

    def at(self, clock: Clock) -> tuple[FloatArray, BoolArray, OutOfRange | None]:
        """Return its values at a clock's rows, which of these are out of range, and what there is to say of them."""
        read, rows, beyond = self.readings()
        outside = np.zeros(len(read), dtype=bool)
        outside[rows] = True
        outside = outside[clock.rows]
        found = out_of_range(self.channel, clock.time_s, outside, float(beyond[0])) if outside.any() else None
        return read[clock.rows], outside, found

    def bring(self, values: FloatArray, turns: Turns) -> tuple[IntArray, FloatArray]:
        """Bring the next of the column's values to the channel's unit, in place; return which are out of range."""
        if self.factor != 1.0:
            values *= self.factor
        if self._runs_from_zero:
            values[np.abs(values) > _HALF_TURN_DEG] -= math.copysign(_TURN_DEG, self.factor)
        rows = np.flatnonzero(np.abs(values) > limit_of(self.channel))
        outside = values[rows]
        values[rows] = np.nan
        if self.channel == "psi":
            turns.undo(values)
        return rows, outside


class Turns:
    """Angles in deg that run on where they jump by a turn, a piece at a time; missing ones are passed over."""

    def __init__(self) -> None:
        self._turns, self._last = 0.0, np.zeros(0)

    def undo(self, angles: FloatArray) -> None:
        """Let the next angles run on, in place."""
        there = np.flatnonzero(np.isfinite(angles))
        if len(there):
            read = angles[there]
            before = self._last if len(self._last) else read[:1]
            run = self._turns + np.cumsum(np.rint(np.diff(read, prepend=before) / 360.0))
            self._turns, self._last = run[-1], read[-1:]
            angles[there] = read - 360.0 * run


def split_mapping(mapping: Sequence[str]) -> dict[str, str]:
    """Return what stands to the right of every channel in texts ``CHANNEL=COLUMN:UNIT``.

    >>> split_mapping(["p=gyro_x:rad/s", "nz=-az:m/s2"])
    {'p': 'gyro_x:rad/s', 'nz': '-az:m/s2'}
    """
    columns: dict[str, str] = {}
    for text in [mapping] if isinstance(mapping, str) else mapping:
        channel, _, column = text.partition("=")
        channel = channel.strip()
        if not channel or not column.strip():
            raise InputError(f"--map '{text}' isn't CHANNEL=COLUMN:UNIT; for example p=gyro_x:rad/s or nz=-az:m/s2")
        meaning = known_as(channel)
        if meaning not in ("", channel):
            raise InputError(
                f"--map '{text}': '{channel}' is no channel; before the = stands one, such as {meaning}, and behind it "
                f"the log's column: --map {meaning}=COLUMN:UNIT"
            )
        if channel in columns:
            raise InputError(f"--map gives '{channel}' twice; once is enough")
        columns[channel] = column.strip()
    return columns


def choose(raw: RawLog, mapped: Mapping[str, str], needs: Sequence[str] | None) -> list[ChosenColumn]:
    """Return the channels of a log: the needed ones, or all."""
    chosen = _mapped_or_recognised(raw, mapped)
    own = {
        series.name: ChosenColumn(channel=series.name, series=series, how=AS_IT_IS) for series in _unknown(raw, chosen)
    }
    if needs is not None:
        lacking = [channel for channel in needs if channel not in chosen and channel not in own]
        if lacking:
            why = _tried(raw, _sure(raw, mapped), _units(mapped)).why_not
            raise InputError(missing(raw, lacking, list(chosen), why))
        return [chosen.get(channel) or own[channel] for channel in needs]
    if list(raw.clocks) == [""]:  # a table's; of a container's topics only what is a channel, or asked for
        chosen |= own
    if not chosen:
        raise InputError(f"no column becomes a channel: {open_questions(raw)}")
    return list(chosen.values())


def choose_of(names: Sequence[str], raw: RawLog, mapped: Mapping[str, str]) -> list[ChosenColumn]:
    """Return those of some channels that a log has."""
    chosen = _mapped_or_recognised(raw, mapped)
    return [chosen[name] for name in names if name in chosen]


def _mapped_or_recognised(raw: RawLog, mapped: Mapping[str, str]) -> dict[str, ChosenColumn]:
    """Return the channels that are settled: as mapped, else by documentation or name, else by physics."""
    units, sure = _units(mapped), _sure(raw, mapped)
    by_name = {series.name: series for series in raw.series}
    tried = {
        meaning.channel: _column_of(by_name[name], meaning, f", guessed by {meaning.guessed}")
        for name, meaning in _tried(raw, sure, units).meanings.items()
    }
    settled = _in_units(raw, units) | tried | sure
    if raw.by_name and not {*GYROS, *ATTITUDE, *ACCELEROMETERS} & set(mapped):
        settled |= _by_motion(raw, settled)
    return {name: choice for name, choice in settled.items() if mapped.get(name) != NONE}


def _sure(raw: RawLog, mapped: Mapping[str, str]) -> dict[str, ChosenColumn]:
    by_mapping = {
        channel: _by_mapping(raw, channel, column)
        for channel, column in mapped.items()
        if channel != UNITS and column != NONE
    }
    return _recognised(raw) | by_mapping


def _units(mapped: Mapping[str, str]) -> str:
    """Return the unit of what states none, rad or deg; "" where nobody says."""
    units = mapped.get(UNITS, "")
    if units not in ("", "rad", "deg"):
        raise InputError(f"--units is '{units}'; it is rad or deg: what angles, and rates per second, are in")
    return units


def _in_units(raw: RawLog, units: str) -> dict[str, ChosenColumn]:
    """Return the gyros and angles that state no unit, in the one that somebody says; of two columns neither."""
    looks: dict[str, list[RawSeries]] = {}
    for series in raw.series if units and raw.by_name else ():
        told = guess(series.name, series.unit)
        if (
            told.channel in (*GYROS, *ATTITUDE)
            and told.meaning is None
            and not stated_unit(series.name, series.unit)[1]
        ):
            looks.setdefault(told.channel, []).append(series)
    return {
        channel: _column_of(
            only[0], Meaning(channel=channel, unit=f"{units}/s" if channel in GYROS else units), ", as told"
        )
        for channel, only in looks.items()
        if len(only) == 1
    }


_WORKED_OUT: WeakKeyDictionary[RawSeries, dict[object, Any]] = WeakKeyDictionary()


def _once(series: RawSeries, key: object, work: Callable[[], Value]) -> Value:
    """Return what is worked out for a column of a log, once for a key, as long as the log is there."""
    before = _WORKED_OUT.setdefault(series, {})
    if key not in before:
        before[key] = work()
    value: Value = before[key]
    return value


def _tried(raw: RawLog, sure: Mapping[str, ChosenColumn], units: str) -> Found:
    """Return what physics say of a log's open columns; once, however often it is asked."""
    if not (raw.by_name and raw.series):
        return NOTHING
    known = {
        channel: (choice.series, choice.meaning)
        for channel in (*GYROS, *ATTITUDE)
        if (choice := sure.get(channel)) is not None and choice.meaning is not None
    }
    key = (raw.time, units, tuple((choice.name, meaning) for choice, meaning in known.values()))
    return _once(raw.series[0], key, lambda: found(raw, known, units))


def _by_motion(raw: RawLog, settled: Mapping[str, ChosenColumn]) -> dict[str, ChosenColumn]:
    """Return the channels whose axes or units motion shows beside those that are settled; once, however often asked."""
    known = {
        name: (choice.series, choice.meaning)
        for name, choice in settled.items()
        if choice.meaning is not None and not is_table_header(choice.series.name)
    }
    if not known:
        return {}

    def shown() -> dict[str, ChosenColumn]:
        turned = in_frame(raw, known)
        told = turned | forces_by_gravity(raw, known | turned)
        return {
            name: _column_of(of, meaning, f", guessed by {meaning.guessed}") for name, (of, meaning) in told.items()
        }

    key = (raw.time, tuple((name, series.name, meaning) for name, (series, meaning) in known.items()))
    return _once(next(iter(known.values()))[0], key, shown)


def _recognised(raw: RawLog) -> dict[str, ChosenColumn]:
    """Return the channels that documentation or names tell without doubt.

    A documented format has an order in which its topics are preferred, and a known source one of its columns; else of
    two columns of a table neither is taken, unless one is named as this package names it.
    """
    recognised = {}
    candidates: dict[str, list[RawSeries]] = {}
    for series in raw.series:
        told = judged(series, raw)
        if told.meaning is not None and told.channel in CHANNELS:
            candidates.setdefault(told.channel, []).append(series)
    for channel, sure in candidates.items():
        stated = [series for series in sure if series.meaning is not None]
        best = stated or [series for series in sure if is_table_header(series.name)] or sure
        if stated and (not raw.by_name or len({series.clock for series in stated}) == 1):
            best = stated[:1]
        if len(best) == 1:
            others = [f"'{series.name}'" for series in sure if series is not best[0]]
            recognised[channel] = _by_meaning(best[0], raw, f", rather than {', '.join(others[:4])}" if others else "")
    return recognised


def _unknown(raw: RawLog, chosen: Mapping[str, ChosenColumn]) -> list[RawSeries]:
    """Return the columns that may stand under their own names: no channel, and not named as one."""
    taken = {id(choice.series) for choice in chosen.values()}
    return [
        series
        for series in raw.series
        if id(series) not in taken
        and series.name not in chosen
        and series.name not in CHANNELS
        and series.name != "time_s"
    ]


def _by_meaning(series: RawSeries, raw: RawLog, rather: str) -> ChosenColumn:
    meaning = judged(series, raw).meaning
    assert meaning is not None  # the caller looked
    turned = meaning.sign < 0 and series.meaning is None
    return _column_of(series, meaning, (" (taken to point down)" if turned else "") + rather)


def _column_of(series: RawSeries, meaning: Meaning, why: str) -> ChosenColumn:
    known = unit(meaning.unit)
    told = f" in {meaning.unit}" if meaning.unit else ""
    return ChosenColumn(
        channel=meaning.channel,
        series=series,
        factor=meaning.sign * (known.factor if known else 1.0),
        how=f"{'-' if meaning.sign < 0 else ''}'{series.name}'{told}{why}",
        meaning=meaning,
    )


def _by_mapping(raw: RawLog, channel: str, column: str) -> ChosenColumn:
    series, meaning = mapped_column(raw, channel, column)
    own = stated_unit(series.name, series.unit)[1]
    but = f", though the column states '{own}'" if own and own != meaning.unit else ""
    late = f", stamped {meaning.late_s:g} s late" if meaning.late_s else ""
    made = _column_of(series, meaning, f"{late}, as mapped{but}")
    return made if channel in CHANNELS else replace(made, factor=meaning.sign)  # another's values are as they are


def mapped_column(raw: RawLog, channel: str, text: str) -> tuple[RawSeries, Meaning]:
    """Return the column that a mapping names, and what the mapping states of it."""
    bare_names: dict[str, list[RawSeries]] = {}
    for series in raw.series:
        bare_names.setdefault(stated_unit(series.name, series.unit)[0], []).append(series)
    by_name = {name: alike[0] for name, alike in bare_names.items() if len(alike) == 1}  # 'az' for 'az [m/s2]'
    by_name |= {series.name: series for series in raw.series}
    before, _, after = map(str.strip, text.rpartition(":"))
    for name, given in ((text, ""), (before, after)):
        for bare, sign in ((name, 1.0), (name.removeprefix("-"), -1.0)):
            if bare in by_name:
                return by_name[bare], _stated(channel, by_name[bare], given, sign)
    name = before or text
    alike = [series.name for series in raw.series if name.lstrip("-").lower() in series.name.lower()][:5]
    likes = f" (perhaps {', '.join(alike)})" if alike else ""
    nearest = "" if alike else meant(name.removeprefix("-"), by_name)
    raise InputError(f"--map {channel}={text}: no column '{name.removeprefix('-')}'{likes}; {there(raw)}{nearest}")


def mapped_axes(
    raw: RawLog, names: Sequence[str], mapped: Mapping[str, str], what: str
) -> list[tuple[RawSeries, Meaning]] | None:
    """Return the columns that are mapped as a sensor's axes, empty where none is; None where it is ``none``."""
    told = [name for name in names if name in mapped]
    if NONE in (mapped[name] for name in told):
        return None
    if 0 < len(told) < len(names):
        lacking = next(name for name in names if name not in mapped)
        raise InputError(f"--map gives {', '.join(told)} and no {lacking}; {what}")
    return [mapped_column(raw, name, mapped[name]) for name in told]


def _stated(channel: str, series: RawSeries, given: str, sign: float) -> Meaning:
    documented = series.meaning
    if documented is not None and documented.channel == channel and not given and sign > 0:
        return documented
    given, late_s = _late(channel, given)
    stated = given or (documented.unit if documented else stated_unit(series.name, series.unit)[1])
    if channel not in CHANNELS and channel != "time":
        return Meaning(channel=channel, unit=stated, sign=sign, late_s=late_s)
    known: Unit | None = unit(stated) if stated else None
    if known is None or known.dimension != dimension_of(channel):
        first, second = hint(channel)
        what = f"'{stated}' isn't a unit of {dimension_of(channel)}" if stated else "the column states no unit"
        raise InputError(f"--map {channel}={series.name}: {what}; give one behind a colon, as :{first} or :{second}")
    return Meaning(channel=channel, unit=stated, sign=sign, late_s=late_s)


def _late(channel: str, given: str) -> tuple[str, float]:
    """Return a unit, and how many seconds late a column is stamped: ``deg@0.3``."""
    stated, at, late = given.partition("@")
    if not at:
        return given, 0.0
    try:
        seconds = float(late.removesuffix("s"))
    except ValueError:
        seconds = float("nan")
    if not abs(seconds) <= _LATEST_S:
        raise InputError(f"--map {channel}=...:{given}: behind @ stands how many seconds late it is, as {stated}@0.3")
    return stated, seconds


def judged(series: RawSeries, raw: RawLog) -> NameGuess:
    """Return what a column is: by the format's documentation, else by its name where names may be believed."""
    if series.meaning is not None:
        return NameGuess(channel=series.meaning.channel, meaning=series.meaning)
    meaning = documented(series.name) if raw.by_name else None
    if meaning is not None:  # an autopilot's, in anybody's table
        return NameGuess(channel=meaning.channel, meaning=meaning)
    return guess(series.name, series.unit) if raw.by_name else NameGuess()


def not_taken(raw: RawLog, channels: Sequence[str]) -> list[str]:
    """Return a line for every column that looks like a channel which the log doesn't have otherwise, a few at most."""
    lines = []
    for series in raw.series:
        told = judged(series, raw)
        if told.channel in CHANNELS and told.channel not in channels:
            lines.append(f"not taken: {_doubt(raw, series, told)}")
    if raw.ignored:
        lines.append(f"not taken, no numbers: {_named(raw.ignored)}")
    return lines[:_MOST_NAMED]


def missing(raw: RawLog, lacking: Sequence[str], channels: Sequence[str], why: str = "") -> str:
    """Return what is said where needed channels aren't there: why, what looks like them, and what is there."""
    names = f"channel{'s' * (len(lacking) > 1)} {', '.join(map(repr, lacking))}"
    unlike = [channel for channel in lacking if _open(raw, channel) == ""]
    asks = list(dict.fromkeys(_open(raw, channel) for channel in lacking if channel not in unlike))
    if unlike and not raw.is_nameless:
        asks.append(f"nothing looks like {listed(unlike, 'or')}: {unit_option(unlike[0], 'COLUMN')}")
    if raw.is_nameless and not asks:
        return f"no {names}; {there(raw)}"
    return (
        f"no {names}: {why or '; '.join(asks)}; channels that are there: {', '.join(channels) or 'none'}; {there(raw)}"
    )


def _open(raw: RawLog, channel: str) -> str:
    """Return what is open about a channel that isn't there; "" where nothing looks like it."""
    looks = [(series, told) for series in raw.series if (told := guess(series.name, series.unit)).channel == channel]
    known = [(series, told) for series in raw.series if (told := judged(series, raw)).channel == channel]
    if channel not in CHANNELS:
        return f"no column has that name{meant(channel, [series.name for series in raw.series])}"
    if known or looks:
        return "; ".join(_doubt(raw, series, told) for series, told in (known or looks)[:3])
    words = [f"column '{name}' {why}" for name, why in of_words(raw).items() if guess(name).channel == channel]
    return "; ".join(words)


def of_words(raw: RawLog) -> dict[str, str]:
    """Return the columns that are named as channels and hold too much text to be one, and why not."""
    channels = {name: guess(name).channel for name in raw.ignored}
    return {name: f"looks like {channel}, but holds text" for name, channel in channels.items() if channel in CHANNELS}


def open_questions(raw: RawLog) -> str:
    """Return what is said where no column becomes a channel."""
    looks = [(series, told) for series in raw.series if (told := judged(series, raw)).channel in CHANNELS]
    return (
        "; ".join(_doubt(raw, series, told) for series, told in looks[:4]) or f"--map CHANNEL=COLUMN:UNIT; {there(raw)}"
    )


def there(raw: RawLog) -> str:
    """Return which columns there are."""
    names = [series.name for series in raw.series]
    numbers = f"its columns: {_named(names)}" if names else "it has no columns of numbers"
    if raw.is_nameless:
        numbers = f"{_NAMELESS}; {numbers}"
    return f"{numbers}; no numbers are in {_named(raw.ignored)}" if raw.ignored else numbers


def _doubt(raw: RawLog, series: RawSeries, told: NameGuess) -> str:
    if told.why_not:
        return f"column '{series.name}' {told.why_not}"
    rivals = [
        other.name for other in raw.series if (also := judged(other, raw)).meaning and also.channel == told.channel
    ]
    others = [f"'{name}'" for name in rivals if name != series.name]
    as_well = f", as may {', '.join(others[:4])}" if others else ""
    return f"column '{series.name}' may be {told.channel}{as_well}: --map {told.channel}=COLUMN"


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(names[:_MOST_NAMED]) + more
