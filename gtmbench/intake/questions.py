"""What is said of columns that aren't taken: which channel they look like, what is left open, how a user may answer."""

from __future__ import annotations

from collections.abc import Sequence

from gtmbench.channels import CHANNELS
from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.names import Guess, asked, guess

_MOST_NAMED = 40


def judged(one: RawSeries, raw: RawLog) -> Guess:
    """Return what a column is: by the format's documentation, else by its name where names may be believed."""
    if one.meaning is not None:
        return Guess(channel=one.meaning.channel, meaning=one.meaning)
    return guess(one.name, one.unit) if raw.by_name else Guess()


def not_taken(raw: RawLog, channels: Sequence[str]) -> list[str]:
    """Return a line for every column that looks like a channel which the log doesn't have otherwise, a few at most."""
    lines = []
    for one in raw.series:
        told = judged(one, raw)
        if told.channel in CHANNELS and told.channel not in channels:
            lines.append(f"not taken: {_doubt(raw, one, told)}")
    if raw.ignored:
        lines.append(f"not taken, no numbers: {_named(raw.ignored)}")
    return lines[:_MOST_NAMED]


def missing(raw: RawLog, channel: str, found: Sequence[str]) -> str:
    """Return what is said where a needed channel isn't there: what looks like it, and what is there."""
    looks = [(one, told) for one in raw.series if (told := guess(one.name, one.unit)).channel == channel]
    known = [(one, told) for one in raw.series if (told := judged(one, raw)).channel == channel]
    if channel not in CHANNELS:
        ask = "no column has that name"
    elif known or looks:
        ask = "; ".join(_doubt(raw, one, told) for one, told in (known or looks)[:3])
    else:
        ask = f"nothing looks like it: {asked(channel, 'COLUMN')}"
    return f"no channel '{channel}': {ask}; channels that are there: {', '.join(found) or 'none'}; {there(raw)}"


def open_questions(raw: RawLog) -> str:
    """Return what is said where no column becomes a channel."""
    looks = [(one, told) for one in raw.series if (told := judged(one, raw)).channel in CHANNELS]
    return "; ".join(_doubt(raw, one, told) for one, told in looks[:4]) or f"--map CHANNEL=COLUMN:UNIT; {there(raw)}"


def there(raw: RawLog) -> str:
    """Return which columns there are."""
    names = [one.name for one in raw.series]
    numbers = f"its columns: {_named(names)}" if names else "it has no columns of numbers"
    return f"{numbers}; no numbers are in {_named(raw.ignored)}" if raw.ignored else numbers


def _doubt(raw: RawLog, one: RawSeries, told: Guess) -> str:
    if told.why_not:
        return f"column '{one.name}' {told.why_not}"
    rivals = [
        other.name for other in raw.series if (also := judged(other, raw)).meaning and also.channel == told.channel
    ]
    others = [f"'{name}'" for name in rivals if name != one.name]
    as_well = f", as may {', '.join(others[:4])}" if others else ""
    return f"column '{one.name}' may be {told.channel}{as_well}: --map {told.channel}=COLUMN"


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(names[:_MOST_NAMED]) + more
