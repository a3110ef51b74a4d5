"""A timeline in words: spans, sizes, what is known of each sensor as a table, and every span in a line."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import NamedTuple

from gtmbench.checks import listed
from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.report.log_findings import reported_sensors
from gtmbench.report.words.judgement import kind_text
from gtmbench.report.words.units import beside_text, clock_text, first_few, time_text
from gtmbench.values.channels import GYROS, unit_of
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, Timeline
from gtmbench.verdict.verdict import LogVerdict

NAMES = {
    "magnetometer": "magnetometer",
    "gps": "GPS",
    "accelerometers": "accelerometers",
    "tas": "airspeed",
    "altitude": "pressure altitude",
    "alpha": "angle-of-attack vane",
    "beta": "sideslip vane",
    "attitude": "attitude",
}
SENSORS = {
    "p": "roll gyro",
    "q": "pitch gyro",
    "r": "yaw gyro",
    "phi": "bank angle",
    "theta": "pitch angle",
    "psi": "heading",
    "nx": "forward accelerometer",
    "ny": "lateral accelerometer",
    "nz": "vertical accelerometer",
}
HEAD = ("sensor", "state", "what would show, or why not")
_MOST = 3  # spans that are written one by one
_LONG_S = 3600.0  # from which on minutes are told
_EDGE_S = 1e-6  # rounding
_SHORT_S = 0.5  # of what isn't judged: less isn't told in the table


class SensorRow(NamedTuple):
    """A sensor's row of the table."""

    sensor: str
    state: str
    why: str


def sensor_text(name: str) -> str:
    """Name a sensor as an engineer does.

    >>> sensor_text("q"), sensor_text("magnetometer"), sensor_text("strain_3"), sensor_text("q of IMU2")
    ('pitch gyro (q)', 'magnetometer', 'strain_3', 'pitch gyro (q) of IMU2')
    """
    own, of, imu = name.partition(" of ")
    if of:
        return f"{sensor_text(own)} of {imu}"
    long = SENSORS.get(name) or NAMES.get(name, name)
    return long if long.lower() == name.lower() else f"{long} ({name})"


def when_text(spans: Sequence[Span], whole_s: Span) -> str:
    """Say from when to when: ``from 100.0 to 112.3 s``, ``from 80.0 s on``; of many spans the first.

    >>> when_text([(10.0, 12.0), (40.0, 60.0)], (0.0, 60.0)), when_text([(0.0, 60.0)], (0.0, 60.0))
    ('from 10.0 to 12.0 s and from 40.0 s on', 'from beginning to end')
    """
    if len(spans) == 1 and spans[0][0] <= whole_s[0] + _EDGE_S and spans[0][1] >= whole_s[1] - _EDGE_S:
        return "from beginning to end"
    told = [
        f"from {time_text(start_s)} on"
        if end_s >= whole_s[1] - _EDGE_S
        else f"from {time_text(start_s).removesuffix(' s')} to {time_text(end_s)}"
        for start_s, end_s in spans
    ]
    return f"{', '.join(told[:_MOST])} and {len(told) - _MOST} times more" if len(told) > _MOST else listed(told)


def of_text(part_s: float, total_s: float) -> str:
    """Say how much of a time: ``172 of 180 s``.

    >>> of_text(171.8, 180.2), of_text(5400.0, 7200.0), of_text(4.26, 8.0)
    ('172 of 180 s', '90 of 120 min', '4.3 of 8.0 s')
    """
    if total_s >= _LONG_S:
        return f"{part_s / 60.0:.0f} of {total_s / 60.0:.0f} min"
    return f"{part_s:.1f} of {total_s:.1f} s" if total_s < 10.0 else f"{part_s:.0f} of {total_s:.0f} s"


def size_text(value: float, *, up: bool = True) -> str:
    """Write a size with two digits that count, never better than it is.

    >>> size_text(0.5), size_text(0.541), size_text(0.678, up=False), size_text(123.0)
    ('0.5', '0.55', '0.67', '130')
    """
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 1)
    counted = value / step
    return f"{float(f'{(math.ceil(counted - 1e-6) if up else math.floor(counted + 1e-6)) * step:.6g}'):g}"


def factors_text(factors: tuple[float, float]) -> str:
    """Say which factors show: one below 1 where those as far above show, too."""
    low, high = factors
    below, above = size_text(low, up=False), size_text(high)
    if not math.isfinite(high):
        return f"a factor below {below}" if low > 0.0 else f"a factor of {below}"
    if not math.isfinite(low):
        return f"a factor above {above}"
    if low == 0.0:
        return f"a factor of {below} or above {above}"
    return f"a factor of {below}" if high <= 2.0 - low + 1e-9 else f"a factor below {below} or above {above}"


def sizes_text(sensor: str, sizes: Sizes | None, *, is_short: bool = False) -> str:
    """Say what would have shown in one sensor: an error that stays, a factor, noise; in short only what would show.

    >>> sizes_text("q", Sizes(error=0.5, within_s=60.0, factors=(0.7, 1.4), noise=1.0))
    '0.5 deg/s, a factor below 0.7 or above 1.4, noise of 1 deg/s'
    >>> sizes_text("q", Sizes(error=0.5, within_s=60.0)), sizes_text("phi", Sizes(error=2.0, within_s=60.0))
    ('0.5 deg/s, not a wrong factor', '2 deg')
    """
    if sizes is None:
        return "from which size on is not known"
    unit = unit_of(sensor)
    parts = [f"{size_text(sizes.error)} {unit}".rstrip()]
    if sizes.factors is not None:
        parts.append(factors_text(sizes.factors))
    elif sensor in GYROS and not is_short:
        parts.append("not a wrong factor")
    if sizes.noise is not None and not is_short:
        parts.append(f"noise of {size_text(sizes.noise)} {unit}".rstrip())
    return ", ".join(parts)


def fault_text(sensor: str, judged: Judgement | None) -> str:
    """Say what kind of fault a judgement found; "" where it says none.

    >>> found = Judgement(time_s=9.0, sensor="q", candidates=("q",), kind="bias", parameters={"size": 3.02})
    >>> fault_text("q", found), fault_text("q", None)
    ('bias 3.02 deg/s', '')
    """
    if judged is None:
        return ""
    if judged.kind is None or judged.kind == UNKNOWN or judged.swapped:
        return ""
    parameters = {name: value for name, value in judged.parameters.items() if name != "onset_s"}
    return kind_text(judged.kind, parameters, judged.intervals, unit_of(judged.sensor or sensor), judged.partner)


def sensor_row(verdict: LogVerdict, sensor: str) -> SensorRow:
    """Return what is known of a sensor: its states, the weightiest first, then faults, sizes and reasons."""
    timeline, moving_s = verdict.timeline, verdict.timeline.motion_total_s
    states, why = [], []
    for state in (State.FAILED, State.SUSPECTED):
        spans = timeline.of(sensor, state)
        if spans:
            states.append(f"{state} {_short_spans(spans, timeline.span_s)}")
            why += [_accused_text(sensor, each) for each in spans]
    clear_s, lost_s = (timeline.motion_in(sensor, state) for state in (State.CLEAR, State.NOT_JUDGED))
    if clear_s > 0.0:
        elsewhere = "elsewhere " if why else ""
        states.append(f"clear {clear_s:.0f} s" if lost_s >= _SHORT_S else "clear")
        why.append(f"{elsewhere}{sizes_text(sensor, verdict.sizes_of(sensor), is_short=True)}")
    reasons = reasons_of(verdict, sensor)
    if not states:
        states, why = [str(State.NOT_JUDGED)], [reasons[0]]
    elif lost_s >= _SHORT_S or not moving_s:
        why.append(f"not judged: {reasons[0]}")
    return SensorRow(sensor, "; ".join(states), "; ".join(part for part in dict.fromkeys(why) if part))


def _short_spans(spans: Sequence[SensorSpan], whole_s: Span) -> str:
    told = [
        f"{clock_text(each.start_s)} on"
        if each.end_s >= whole_s[1] - _EDGE_S
        else f"{clock_text(each.start_s).removesuffix(' s')}-{clock_text(each.end_s)}"
        for each in spans
    ]
    return first_few(told, _MOST)


def reasons_of(verdict: LogVerdict, sensor: str) -> tuple[str, ...]:
    """Return why a sensor isn't judged, in words."""
    if sensor not in verdict.timeline.sensors:
        return ("the log has no such sensor",)
    reasons = tuple(reason.rstrip(".") for reason in verdict.reasons_of(sensor) if reason)
    return reasons or (("nothing moves",) if verdict.timeline.motion_total_s <= 0.0 else ("no reason is known",))


def _accused_text(sensor: str, span: SensorSpan) -> str:
    others = [name for name in span.suspects if name != sensor]
    either = f"it or {listed(others, 'or')}" if others else ""
    judged = span.judgement  # its kind is that of the likeliest
    is_likeliest = judged is not None and sensor in (judged.sensor, *judged.candidates[:1], judged.partner)
    fault = fault_text(sensor, judged) if is_likeliest else ""
    return ": ".join(part for part in (either, fault or span.reason) if part)


def timeline_rows(verdict: LogVerdict) -> list[SensorRow]:
    """Return a row for each sensor that is asked, and for others that failed or are suspected."""
    shown = dict.fromkeys([*verdict.scope.sensors, *reported_sensors(verdict)])
    return [sensor_row(verdict, sensor) for sensor in shown]


def table_lines(rows: Sequence[SensorRow], width: int, most: int) -> list[str]:
    """Return the table, no line wider than a screen, `most` lines with the heading; the calm give way."""
    if not rows or most < 2:
        return []
    kept = list(rows)
    if len(kept) > most - 1:
        # what failed, what is suspected, not judged, clear
        states = [next(i for i, state in enumerate((*State, "")) if row.state.startswith(state)) for row in kept]
        weighty = sorted(range(len(kept)), key=states.__getitem__)[: max(most - 2, 0)]
        kept = [kept[place] for place in sorted(weighty)]
    left = len(rows) - len(kept)
    cells = [SensorRow(*HEAD), *kept]
    sensors = max(len(row.sensor) for row in cells)
    # what is longer is cut
    wide = min(max(len(row.state) for row in cells), max(34, width // 2 - sensors))
    lines = [cut(f"{row.sensor:{sensors}}  {cut(row.state, wide):{wide}}  {row.why}".rstrip(), width) for row in cells]
    return [*lines, f"... and {left} more: --details"] if left else lines


def cut(text: str, width: int) -> str:
    """Shorten a text to a width, between words where that is possible."""
    if len(text) <= width:
        return text
    short = text[: width - 3]
    is_within = text[width - 3] != " " and " " in short[width // 2 :]  # of a word that needn't be broken
    whole = short.rsplit(" ", 1)[0] if is_within else short
    return f"{whole.rstrip(' ,;')}..."


def span_lines(timeline: Timeline, zero_stamp: str = "") -> list[str]:
    """Return every span of every sensor, a line a span, nothing of it shortened; with a log's stamps beside."""
    lines = ["timeline (times in s on the log's clock; sizes: the smallest error, factor and noise that would show):"]
    widest = max(map(len, timeline.sensors), default=0)
    for sensor, spans in timeline.sensors.items():
        for span in spans:
            text = span_text(sensor, span)
            beside = beside_text(zero_stamp, span.start_s, span.end_s)
            times = f"{span.start_s:z.2f} to {span.end_s:z.2f}{beside}"
            lines.append(f"  {sensor:{widest}}  {times}  {span.state}{text}")
    return lines if len(lines) > 1 else []


def span_text(sensor: str, span: SensorSpan) -> str:
    """Say what is known of one span beside its state: sizes, the fault, or the reason."""
    if span.state is State.CLEAR:
        within = "" if span.sizes is None else f" within {span.sizes.within_s:g} s"
        return f": {sizes_text(sensor, span.sizes)}{within}"
    if span.state is State.NOT_JUDGED:
        return f": {span.reason}" if span.reason else ""
    text = _accused_text(sensor, span)
    more = f" ({span.reason})" if span.reason and span.reason not in text else ""
    return f": {text}{more}" if text else more


def wrapped(text: str, width: int) -> list[str]:
    """Break a sentence into lines that fit a screen."""
    return textwrap.wrap(text, width, break_on_hyphens=False)
