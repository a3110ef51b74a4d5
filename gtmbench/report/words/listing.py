"""What a log holds and what can be done with it, on one screen."""

from __future__ import annotations

import math
import shlex
import textwrap
from collections.abc import Iterable, Sequence

from gtmbench.detectors.bank.bank import load_bank
from gtmbench.detectors.bank.composed import AUTO, composed_bank
from gtmbench.errors import InputError
from gtmbench.files.shipped import shipped_banks
from gtmbench.intake.contents import LogChannel, LogContents
from gtmbench.method.pseudo_inputs import derivable
from gtmbench.report.words.log import events_lines
from gtmbench.report.words.units import counted, padded
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, CHANNELS, GYROS

_KINDS = (
    ("gyros", GYROS),
    ("attitude", ATTITUDE),
    ("accelerometers", ACCELEROMETERS),
    ("air data", ("alpha", "beta", "tas")),
    ("others", tuple(CHANNELS)),
)
_MOST = 4  # lines on what is open, or of no use
_LONGEST = 4  # lines of the screen


def listing_lines(contents: LogContents, width: int) -> list[str]:
    """Return the listing, no line longer than the screen is wide: what is there, then what can be watched, and how."""
    width = max(width, 60)
    lines = [contents_verdict(contents), *([f"no time: {contents.no_time}"] if contents.no_time else contents.notes)]
    lines += _sensor_lines(contents.channels, width)
    useless = [] if contents.no_time else [each for each in contents.channels if each.why_not]
    bad = [f"not usable: {each.name}, {each.why_not}" for each in useless]
    doubtful = [f"open: '{column.name}' {column.why_not}" for column in contents.columns if column.why_not]
    for told in (bad, doubtful):
        lines += told[:_MOST] + ([f"... and {len(told) - _MOST} more: --list --details"] if len(told) > _MOST else [])
    by_reason: dict[str, list[str]] = {}
    for each in contents.channels:
        if each.guessed:
            by_reason.setdefault(f"{each.unit} by {each.guessed}", []).append(each.name)
    lines += [f"guessed: {', '.join(names)} in {why}" for why, names in by_reason.items()]
    if contents.imus:
        lines.append(f"IMUs: {len(contents.imus)} ({', '.join(contents.imus)})")
    lines += events_lines(contents.events)
    lines += _watch_lines(contents)
    return [part for line in lines for part in _wrapped(line, width)]


def contents_verdict(contents: LogContents) -> str:
    """Say in a sentence what a log is."""
    span = "" if contents.span_s is None else f" from {contents.span_s[0]:.2f} to {contents.span_s[1]:.2f} s"
    columns = counted(len(contents.columns), "column")
    return f"{contents.path.name} ({contents.kind}){span} has {columns}; --list --details lists them."


def _sensor_lines(channels: Sequence[LogChannel], width: int) -> list[str]:
    """Return a line for every kind of sensor and rate: channels, how often they are new, columns."""
    rows = []
    left = list(channels)
    for kind, names in _KINDS:
        own = [each for each in left if each.name in names]
        left = [each for each in left if each.name not in names]
        for rate in dict.fromkeys(map(_rate, own)):
            same = [each for each in own if _rate(each) == rate]
            marked = [f"({each.name})" if each.why_not else each.name for each in same]
            rows.append((kind, " ".join(marked), rate, _columns([each.column for each in same])))
    if not rows:
        return ["no column becomes a channel"]
    return [_cut("  ".join(row).rstrip(), width) for row in padded(rows)]


def _rate(channel: LogChannel) -> str:
    if not math.isfinite(channel.fresh_hz):
        return "-"
    if channel.fresh_hz < 0.9 * channel.logged_hz:
        return f"{channel.fresh_hz:.3g} Hz (logged at {channel.logged_hz:.3g})"
    return f"{channel.fresh_hz:.3g} Hz"


def _columns(names: Sequence[str]) -> str:
    """Return columns of one topic by their fields: ``IMU.GyrX, GyrY, GyrZ``."""
    topic = names[0].rpartition(".")[0]
    rest = [name.removeprefix(f"{topic}.") if topic else name for name in names[1:]]
    return ", ".join([names[0], *rest])


def _watch_lines(contents: LogContents) -> list[str]:
    """Say which banks the log allows, and what to type."""
    there = contents.usable
    possible, lacking = banks_for(there)
    log = shlex.quote(contents.path.name)
    lines = []
    try:
        bank = composed_bank(there, attitude_from_gyros=contents.attitude_from_gyros)
        lines.append(f"watch it: gtmbench monitor {log}")
        lines.append(f"bank {AUTO}: possible ({bank.title})")
    except InputError as error:
        lines.append(str(error).replace(f"bank {AUTO}", f"bank {AUTO}: no, it", 1))
    if possible:
        lines.append(f"with --detector: bank {', '.join(possible)}")
    lines += [f"bank {', '.join(names)}: no, {missing} missing" for missing, names in lacking.items()]
    lines.append(f"pseudo inputs: {', '.join(derivable(there)) or 'none'}")
    return lines


def banks_for(channels: Iterable[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Return the shipped banks that some channels allow, and the others by what they lack."""
    there = set(channels)
    possible: list[str] = []
    lacking: dict[str, list[str]] = {}
    for name in shipped_banks():
        missing = [channel for channel in load_bank(name).channels if channel not in there]
        if missing:
            lacking.setdefault(", ".join(missing), []).append(name)
        else:
            possible.append(name)
    return possible, lacking


def _wrapped(line: str, width: int) -> list[str]:
    line = _cut(line, _LONGEST * width)  # names may be of any length
    return textwrap.wrap(line, width, subsequent_indent="  ", break_on_hyphens=False) if len(line) > width else [line]


def _cut(line: str, width: int) -> str:
    return line if len(line) <= width else f"{line[: width - 4]} ..."
