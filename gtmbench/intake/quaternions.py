"""Attitudes that a table has as quaternions, as angles beside its own columns."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from gtmbench.intake.formats.dialects import angles_of, indexed
from gtmbench.intake.formats.raw import Meaning, RawLog, RawSeries
from gtmbench.intake.names import guess
from gtmbench.values.channels import ATTITUDE

_NAMED = re.compile(
    r"(?i)(?P<stem>.{0,200}?(?:(?<![a-z])q|quat|quaternion|orientation|attitude)[_.]?)(?P<part>[wxyz0-3]|\[[0-3]\])"
)
_OF_ROS = re.compile(r"(?i)orientation|pose")  # where axes point forward, left and up


def with_quaternions(raw: RawLog) -> RawLog:
    """Return a table with roll, pitch and yaw of every quaternion that it has, as columns ``q(roll)`` in deg.

    Named ``qw, qx, qy, qz``, ``q0`` to ``q3`` or ``q[0]`` to ``q[3]``, w first, from the body (forward, right, down) to
    the world, they are channels where no other column is; what is named as ROS names it may point left and up, and has
    to be mapped.
    """
    if not raw.by_name:
        return raw
    told = {(series.meaning or guess(series.name, series.unit)).channel for series in raw.series}
    names = {series.name for series in raw.series}
    added, notes = [], []
    found = list(_quaternions(raw))
    only = len([stem for stem, _ in found if not _OF_ROS.search(stem)]) == 1  # of several none is preferred
    for stem, parts in found:
        if f"{stem.rstrip('_.')}(roll)" in names:  # its format has made them already
            continue
        known = only and not _OF_ROS.search(stem) and not told & set(ATTITUDE)
        meanings = [Meaning(channel=channel, unit="deg") if known else None for channel in ATTITUDE]
        made = angles_of(parts, stem.rstrip("_."), meanings)
        added += made
        if known:
            first, *_, last = made[0].made_of
            notes.append(
                f"{first} ... {last}: taken as a quaternion from body (forward, right, down) to world, w first"
            )
            told |= set(ATTITUDE)
    return replace(raw, series=(*raw.series, *added), notes=(*raw.notes, *notes)) if added else raw


def _quaternions(raw: RawLog) -> Iterator[tuple[str, list[RawSeries]]]:
    """Yield the quaternions of a log: what their columns' names begin with, and w, x, y, z."""
    by_stem: dict[tuple[str, str], dict[str, RawSeries]] = {}
    for series in raw.series:
        named = _NAMED.fullmatch(indexed(series.name))
        if named:
            by_stem.setdefault((named["stem"], series.clock), {})[named["part"].strip("[]").lower()] = series
    for (stem, _), parts in by_stem.items():
        for names in ("wxyz", "0123"):
            if set(names) <= set(parts):
                yield stem, [parts[name] for name in names]
                break
