"""A watched log as a page, with panels as SVG: what an engineer files with a ticket, or sends to a colleague.

A panel is as wide as the log. A line keeps every sample about the faults, and elsewhere the least and the greatest of
as many as a screen can't tell apart, so that a page of an hour stays small.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.files.seals import file_digest
from gtmbench.intake.formats.registry import split_part
from gtmbench.log.judging.claims import began_s
from gtmbench.log.opening.records import whole_s
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.figures.panels import thinned
from gtmbench.report.log_findings import (
    about,
    faults_of,
    reported_sensors,
    residuals_of,
    scores_of,
    signals_of,
)
from gtmbench.report.markup import html_page
from gtmbench.report.style import LOWEST, STATES, level
from gtmbench.report.tables.results import versions
from gtmbench.report.words.found import COLUMNS as FINDING_COLUMNS
from gtmbench.report.words.found import certificate_notes, certificate_table, certificate_title, finding_rows, made_text
from gtmbench.report.words.judgement import alarm_text
from gtmbench.report.words.log import detail_lines, event_name
from gtmbench.report.words.others import gps_lines, sensor_lines
from gtmbench.report.words.timeline import HEAD, sensor_text, span_text, timeline_rows
from gtmbench.report.words.units import (
    beside_text,
    capitalised,
    duration_text,
    round_times,
    round_values,
    time_text,
    time_title,
)
from gtmbench.report.words.verdict import labelled, verdict_text
from gtmbench.values.channels import unit_of
from gtmbench.values.record import FloatArray, Span
from gtmbench.version import __version__

_MOST_FAULTS = 4  # that are shown large
_MOST_ROWS = 40  # of a table
_MOST_LEVELS = 6  # test statistics in one panel
_MEASURED, _PREDICTED, _RESIDUAL = "measured", "predicted", "residual"


def flight_page(watched: WatchedLog, command: str) -> str:
    """Return a watched log as one HTML page that needs no network.

    It holds no path, user or machine of where it was made, and no position.

    `command`: what repeats it, as it is typed where the log lies.
    """
    log, span, zero = watched.log, whole_s(watched.log), watched.log.zero_stamp
    length = duration_text((span[1] - span[0]) / 3600.0)
    faults = [same[0] for same in faults_of(watched).values()][:_MOST_FAULTS]
    close = [about(fault, span) for fault in faults]
    title, *cells = certificate_table(watched.certificate) or [[]]
    return html_page(
        "flight.html.j2",
        "flight.js",
        "flight.css",
        said=_placeless(log.path),
        title=verdict_text(watched),
        outcome=watched.verdict.outcome.name.lower(),
        log=f"{log.path.name}: {length} of flight, {1.0 / log.sample_period_s:.4g} samples a second",
        labelled=[(label, text) for label, text in labelled(watched) if label != "Next" or watched.check.causes],
        span=(0.0, round(span[1] - span[0], 3)),
        start_s=span[0],
        ticks=time_ticks(span),
        time_title=time_title(span),
        zero=zero,
        panels=panels(watched, span, close),
        marks=marks(watched),
        lanes=[(sensor, sensor_text(sensor), bands(watched, sensor)) for sensor in reported_sensors(watched.verdict)],
        states=list(STATES.items()),
        windows=[(f"Fault at {time_text(began_s(fault))}", *near) for fault, near in zip(faults, close, strict=True)],
        alarms=[_alarm_row(alarm, zero) for alarm in watched.alarms[:_MOST_ROWS]],
        more_alarms=max(len(watched.alarms) - _MOST_ROWS, 0),
        explained=(FINDING_COLUMNS, finding_rows(watched.judged, watched.course)),
        events=[(_time_text(event.time_s, zero), event_name(event)) for event in log.events[:_MOST_ROWS]],
        more_events=max(len(log.events) - _MOST_ROWS, 0),
        table_of=(HEAD, timeline_rows(watched.verdict)),
        told=watched.verdict.timeline.told,
        certificate=(certificate_title(watched.certificate), title, cells) if cells else None,
        certificate_notes=[
            *certificate_notes(watched.certificate),
            *sensor_lines(watched.sensors),
            *gps_lines(watched.gps),
        ],
        details="\n".join(detail_lines(watched)),
        facts=[
            ("Log", _digest_text(log.path)),
            ("Versions", ", ".join(f"{name} {version}" for name, version in versions().items())),
        ],
        command=command,
        made_by=f"Made by gtmbench {__version__} of the log alone; it says where sensors are not judged, and why.",
    )


def panels(watched: WatchedLog, span: Span, close: Sequence[Span]) -> list[Panel]:
    """Return what is drawn: test statistics over their thresholds, then every sensor and its residual."""
    drawn = partial(panel, span=span, close=close)
    made = [*_level_panels(watched, drawn), *_evidence_panels(watched, drawn)]
    for name in signals_of(watched):
        unit = unit_of(name)
        lines: list[tuple[str, str, Series]] = [
            (_MEASURED, _MEASURED, [(segment.time_s, segment[name]) for segment in watched.log.segments])
        ]
        virtual = [(watch.record.time_s, watch.virtual(name)) for watch in watched.watches if name in watch.record]
        if any(np.isfinite(values).any() for _, values in virtual):
            lines.append((_PREDICTED, _PREDICTED, virtual))
        title, own_bands, alarms = sensor_text(name), bands(watched, name), _alarms_text(watched)
        described = f"{title}, measured and predicted from the other sensors. {alarms}"
        made.append(drawn(capitalised(title), unit, lines, bands=own_bands, description=described))
        if name in residuals_of(watched):
            residual = [(watch.record.time_s, watch.residuals[name]) for watch in watched.watches]
            described, own = f"{title}, measured minus predicted. {alarms}", [(_RESIDUAL, _RESIDUAL, residual)]
            made.append(drawn(f"Residual of {name}", unit, own, bands=own_bands, description=described))
    return made


def _level_panels(watched: WatchedLog, drawn: Callable[..., Panel]) -> list[Panel]:
    """Return the panel of those test statistics that came nearest to their thresholds; none where there are none."""
    levels: dict[str, Series] = {
        name: [
            (watch.scores[name].known_s, np.log10(np.maximum(level(watch.scores[name]), LOWEST)))
            for watch in watched.watches
            if name in watch.scores
        ]
        for name in scores_of(watched)
    }
    peaks = {name: max(float(np.nanmax(values, initial=-9.0)) for _, values in parts) for name, parts in levels.items()}
    largest = sorted(peaks, key=lambda name: -peaks[name])[:_MOST_LEVELS]
    if not largest:
        return []
    lines = [
        (name, f"level{place}", levels[name]) for place, name in enumerate(name for name in levels if name in largest)
    ]
    described = f"Test statistics over their thresholds: an alarm above 1. {_alarms_text(watched)}"
    few = f", the {_MOST_LEVELS} largest of {len(levels)}" if len(levels) > _MOST_LEVELS else ""
    title = f"Test statistics over their thresholds{few}"
    return [drawn(title, "alarm above 1", lines, is_logarithmic=True, limits=[0.0], description=described)]


def _evidence_panels(watched: WatchedLog, drawn: Callable[..., Panel]) -> list[Panel]:
    """Return what shows that somebody may have failed, an equation each, beside what the failure makes of it."""
    made = []
    for curve in watched.curves[:6]:
        lines: list[tuple[str, str, Series]] = [
            (_MEASURED, _MEASURED, [(curve.time_s, curve.measured)]),
            (_PREDICTED, _PREDICTED, [(curve.time_s, curve.predicted)]),
        ]
        title = f"{curve.said}, and predicted for {made_text(curve)}"
        made.append(drawn(title, curve.unit, lines, bands=bands(watched, curve.sensor), description=f"{title}."))
    return made


def bands(watched: WatchedLog, sensor: str) -> list[Mark]:
    """Return a sensor's timeline, a band a span; none of a sensor that has no timeline."""
    start_s, zero = whole_s(watched.log)[0], watched.log.zero_stamp
    return [
        Mark(
            start_s=each.start_s - start_s,
            end_s=each.end_s - start_s,
            look=each.state.name.lower(),
            name=f"{sensor}, {each.start_s:.1f} to {each.end_s:.1f} s{beside_text(zero, each.start_s, each.end_s)}: "
            f"{each.state}{span_text(sensor, each)}",
        )
        for each in watched.verdict.timeline.sensors.get(sensor, ())
    ]


def marks(watched: WatchedLog) -> list[Mark]:
    """Return the instants that stand in every panel: when faults began, alarms and names."""
    start_s = whole_s(watched.log)[0]
    instants = []
    for alarm in watched.alarms[:_MOST_ROWS]:
        instants += [(began_s(alarm), "began", "began"), (alarm.time_s, "alarm", "alarm")]
        if alarm.isolated_s is not None:
            instants.append((alarm.isolated_s, "named", "sensor named"))
    return [
        Mark(start_s=time_s - start_s, end_s=time_s - start_s, look=look, name=name) for time_s, look, name in instants
    ]


def _alarm_row(alarm: Alarm, zero_stamp: str) -> tuple[str, ...]:
    what = "nothing is left to explain: a false alarm" if alarm.has_passed else alarm_text(alarm)
    times = (began_s(alarm), alarm.time_s, alarm.isolated_s, alarm.ended_s)
    return *("" if time_s is None else _time_text(time_s, zero_stamp) for time_s in times), what


def _time_text(time_s: float, zero_stamp: str) -> str:
    return f"{time_s:.2f}{beside_text(zero_stamp, time_s)}"


def _alarms_text(watched: WatchedLog) -> str:
    told = [f"alarm at {alarm.time_s:.1f} s" for alarm in watched.alarms if not alarm.has_passed]
    return f"{capitalised(', '.join(told[:_MOST_FAULTS]))}." if told else "No alarm."


def _digest_text(path: Path) -> str:
    """Return what shows that a log is this one."""
    whole, part = split_part(path)
    if not whole.is_file():
        return path.name
    size = whole.stat().st_size
    return f"{path.name}{f' of {whole.name}' * bool(part)}, {size} bytes, SHA-256 {file_digest(whole)}"


def _placeless(path: Path) -> Callable[[str], str]:
    """Return what takes the folders of where a page is made out of its texts."""
    own = {str(path.parent), str(path.parent.absolute()), str(Path.home())} - {".", os.sep}
    folders = [f"{folder}{os.sep}" for folder in sorted(own, key=len, reverse=True)]

    def said(text: str) -> str:
        for folder in folders:
            text = text.replace(folder, "")
        return text

    return said


_POINTS = 2400  # of a line over the whole log
_DIGITS = 4  # of a value, of the panel's height
_EDGE = 0.04  # of an axis


@dataclass(frozen=True, kw_only=True)
class Mark:
    """An instant, or a span of time, of every panel."""

    start_s: float
    end_s: float
    look: str
    name: str


Tick = dict[str, Any]  # a place on an axis, as a `share` of its length, and its `name`


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Lines over one axis."""

    title: str
    unit: str
    lines: Sequence[dict[str, str]]  # each a name, a look (a class of the page's style) and its path
    # low, high: the axis, in the lines' units; of a logarithmic one the exponents of 10
    low: float
    high: float
    is_logarithmic: bool = False
    description: str = ""  # what a screen reader says
    limits: Sequence[float] = ()  # values that are drawn across, such as a threshold
    bands: Sequence[Mark] = ()  # spans of time behind the lines, such as a sensor's timeline

    @property
    def ticks(self) -> list[Tick]:
        """Round values on the axis, but those whose words would stand in the panels above or below."""
        powers = range(math.ceil(self.low), math.floor(self.high) + 1)
        values = [*map(float, powers)] if self.is_logarithmic else round_values((self.low, self.high))
        names = [f"{10.0**value if self.is_logarithmic else value:g}" for value in values]
        shares = [(value - self.low) / (self.high - self.low) for value in values]
        made: list[Tick] = [{"share": share, "name": name} for share, name in zip(shares, names, strict=True)]
        return [tick for tick in made if _EDGE <= tick["share"] <= 1.0 - _EDGE] or made


Series = Sequence[tuple[FloatArray, FloatArray]]  # times in s, and values: a part after the other


def panel(
    title: str,
    unit: str,
    lines: Sequence[tuple[str, str, Series]],
    *,
    span: Span,
    close: Sequence[Span],
    limits: Sequence[float] = (),
    **how: Any,
) -> Panel:
    """Return a panel of lines, each a name, a look and its parts; times are counted from the span's start.

    `close`: spans that are drawn more finely. **how: else is as `Panel` takes it.
    """
    drawn = [values[np.isfinite(values)] for _, _, parts in lines for _, values in parts]
    there = np.concatenate([*drawn, np.asarray(limits, dtype=np.float64)])
    low, high = (float(there.min()), float(there.max())) if there.size else (0.0, 1.0)
    room = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    low, high = low - room, high + room
    paths = [_path([_shown(part, span, close) for part in parts], span[0], high - low) for _, _, parts in lines]
    made = [{"name": name, "look": look, "path": path} for (name, look, _), path in zip(lines, paths, strict=True)]
    return Panel(title=title, unit=unit, lines=made, low=low, high=high, limits=limits, **how)


def time_ticks(span: Span) -> list[Tick]:
    """Return round instants of a log's clock, as shares of a span."""
    return [{"share": (time_s - span[0]) / (span[1] - span[0]), "name": name} for time_s, name in round_times(span)]


def _shown(part: tuple[FloatArray, FloatArray], span: Span, close: Sequence[Span]) -> tuple[FloatArray, FloatArray]:
    """Return a part of a line as it is drawn: thinned, but about the faults."""
    time_s, values = part
    if not len(time_s):
        return part
    share = (time_s[-1] - time_s[0]) / max(span[1] - span[0], 1e-9)
    coarse_s, coarse = _thinned(time_s, values, max(_POINTS * share, 2.0))
    for start_s, end_s in close:
        inside = (time_s >= start_s) & (time_s <= end_s)
        if inside.any():
            outside = (coarse_s < start_s) | (coarse_s > end_s)
            fine_s, fine = _thinned(time_s[inside], values[inside], 3000)
            coarse_s, coarse = np.append(coarse_s[outside], fine_s), np.append(coarse[outside], fine)
            order = np.argsort(coarse_s, kind="stable")
            coarse_s, coarse = coarse_s[order], coarse[order]
    return coarse_s, coarse


def _thinned(time_s: FloatArray, values: FloatArray, points: float) -> tuple[FloatArray, FloatArray]:
    return thinned(time_s, values, every=max(1, math.ceil(2 * len(values) / points)))


def _path(parts: Series, start_s: float, height: float) -> str:
    """Return an SVG path; what is missing, and the parts' ends, break it."""
    digits = max(0, _DIGITS - 1 - math.floor(math.log10(height)))
    return " ".join(text for time_s, values in parts for text in _strokes(time_s - start_s, values, digits))


def _strokes(time_s: FloatArray, values: FloatArray, digits: int) -> Iterator[str]:
    known = np.isfinite(values)
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        points = zip(time_s[first:last].tolist(), values[first:last].tolist(), strict=True)
        yield "M" + " ".join(f"{_short(time, 3)},{_short(value, digits)}" for time, value in points)


def _short(value: float, digits: int) -> str:
    text = f"{value:z.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
