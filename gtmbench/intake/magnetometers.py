"""The magnetometers of a log: which columns they are, and the field about three axes, with stamps of its own.

No channel of a bank is made of them. They are asked which is wrong, the yaw gyro or the heading, and whoever asks
learns their scale and their iron on what is healthy: so their unit doesn't matter. Axes are taken for the gyros'; one
that has others knows the yaw rate badly there, and then says so.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.mapping import mapped_axes
from gtmbench.intake.names import stated_unit
from gtmbench.intake.stamps import cleaned_alone
from gtmbench.values.channels import MAGNETOMETER
from gtmbench.values.record import FloatArray

# topics and fields of PX4's messages, ArduPilot's and MAVLink's; of PX4's, the first that a log has
_PX4 = (
    (re.compile(r"vehicle_magnetometer(#\d+)?"), tuple(f"magnetometer_ga[{axis}]" for axis in range(3))),
    (re.compile(r"sensor_combined"), tuple(f"magnetometer_ga[{axis}]" for axis in range(3))),
    (re.compile(r"sensor_mag(#\d+)?"), ("x", "y", "z")),
)
_LAYOUTS = (
    (re.compile(r"MAG\d?(#\d+)?"), ("MagX", "MagY", "MagZ")),
    (re.compile(r"HIGHRES_IMU|(SCALED|RAW)_IMU\d?"), ("xmag", "ymag", "zmag")),
)
_NAMED = re.compile(r"(?P<stem>.*?)(?:(?:mag|magnetometer|magneticfield|magfield)(?P<axis>[xyz])|(?P<first>[xyz])mag)")
_SHORT = re.compile(r"m([xyz])")


_Triple = tuple[str, Sequence[RawSeries], Sequence[float]]  # a name, columns along x, y, z, and their signs


def magnetometer_columns(raw: RawLog, mapped: Mapping[str, str]) -> Iterator[_Triple]:
    """Give the columns of each magnetometer along x, y and z, with their signs."""
    pairs = mapped_axes(raw, MAGNETOMETER, mapped, "a magnetometer has three axes")
    if pairs is None:
        return
    if pairs:
        yield "the mapped magnetometer", [series for series, _ in pairs], [meaning.sign for _, meaning in pairs]
        return
    by_name = {series.name: series for series in raw.series}
    px4 = next((own for layout in _PX4 if (own := list(_of_topics(raw, by_name, (layout,))))), [])
    documented = [*px4, *_of_topics(raw, by_name, _LAYOUTS)]
    yield from documented or (_of_names(raw) if raw.by_name else ())


def _of_topics(
    raw: RawLog, by_name: Mapping[str, RawSeries], layouts: Sequence[tuple[re.Pattern[str], Sequence[str]]]
) -> Iterator[_Triple]:
    for topic in sorted(raw.clocks):
        for layout, fields in layouts:
            names = [f"{topic}.{field}" for field in fields]
            if layout.fullmatch(topic) and set(names) <= by_name.keys():
                yield topic, [by_name[name] for name in names], (1.0, 1.0, 1.0)


def _of_names(raw: RawLog) -> Iterator[_Triple]:
    """Give the columns of a table that are named as the axes of a magnetometer."""
    found: dict[tuple[str, str], dict[str, RawSeries]] = {}
    for series in raw.series:
        base = stated_unit(series.name, series.unit)[0]
        key = re.sub(r"[^a-z0-9]", "", base.lower())
        named = _NAMED.fullmatch(key)
        short = _SHORT.fullmatch(key)
        if named:
            axis, stem = named["axis"] or named["first"], f"{named['stem']}mag"
        elif short:
            axis, stem = short[1], "m"
        else:
            continue
        found.setdefault((series.clock, stem), {}).setdefault(axis, series)
    for axes in found.values():
        if set(axes) == set("xyz"):
            base = stated_unit(axes["x"].name, axes["x"].unit)[0]
            name = re.sub(r"[\s_.]*x$", "", base, flags=re.IGNORECASE)
            yield name or base, [axes[axis] for axis in "xyz"], (1.0, 1.0, 1.0)


def field_rows(axes: Sequence[RawSeries], signs: Sequence[float], raw: RawLog) -> tuple[FloatArray, FloatArray] | None:
    """Return when a magnetometer was logged, and the field then, repeats among it; None where when isn't known."""
    clocks = {series.clock for series in axes}
    if len(clocks) != 1 or not clocks <= raw.clocks.keys():
        return None
    own = cleaned_alone(raw.clocks[clocks.pop()])
    if own is None:
        return None
    values = np.column_stack([series.stored() * sign for series, sign in zip(axes, signs, strict=True)])[own.rows]
    read = (np.nan_to_num(values) != 0.0).any(axis=1) & np.isfinite(own.time_s)
    return own.time_s[read], values[read]
