"""Two recordings laid over each other in one.

==========================  ================================================================================
entity                      holds
==========================  ================================================================================
``/A/...``, ``/B/...``      every series that differs, of either recording, under its entity and its name
``/both/...``               series that are equal
``/difference/...``         B - A, at the times that both know
``/events``                 what both tell, and what only one does
``/summary``                what differs, in words
==========================  ================================================================================

On the timeline ``time``, under one blueprint: first what differs most, with the differences beside it, then everything.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from gtmbench.channels import CHANNELS
from gtmbench.record import FloatArray
from gtmbench.report.recording.diff import Comparison, Line, LineDifference, Name, events, lines
from gtmbench.report.recording.lines import log_lines, log_mark, rgb
from gtmbench.report.recording.overlay_blueprint import overlay_blueprint, standing
from gtmbench.report.recording.timeline import set_time

if TYPE_CHECKING:
    import pandas as pd

TINTS = {"A": "#1f77b4", "B": "#ff7f0e", "both": "#7f7f7f", "difference": "#d62728"}
_WIDTHS = {"A": 4.0, "B": 1.0}  # B on A: where they are equal, A shows on both sides of B
_MOST_WORDS = 30  # rows of a table of the summary


def write_overlay(
    a: pd.DataFrame, b: pd.DataFrame, found: Comparison, path: Path, *, names: tuple[str, str] = ("A", "B")
) -> None:
    """Write two recordings, as `read_recording` gives them, over each other; `found` is how they compare."""
    rr.set_strict_mode(True)  # an error must not become a warning and lost data
    recording = rr.RecordingStream("gtmbench")  # a fresh recording id: two of one id don't open side by side
    parts = _parts(lines(a), lines(b), found)
    recording.save(path, default_blueprint=overlay_blueprint(parts, found))
    recording.send_recording_name(f"gtmbench overlay: A {names[0]}, B {names[1]}")
    for which, series in parts.items():
        for name, (time_s, values) in series.items():
            _log(recording, which, name, time_s, values)
    _log_events(recording, a, b)
    recording.log("/summary", rr.TextDocument(_summary(found, names), media_type="text/markdown"), static=True)
    recording.disconnect()  # writes the footer


def _parts(a: dict[Name, Line], b: dict[Name, Line], found: Comparison) -> dict[str, dict[Name, Line]]:
    """Sort the series: those of A and B that differ, their differences, and those that are equal."""
    own = {(line.entity, line.series) for line in found.lines} | set(found.only_a) | set(found.only_b)
    differing = [(line.entity, line.series) for line in found.lines]
    return {
        "both": {name: line for name, line in a.items() if name not in own},
        "A": {name: line for name, line in a.items() if name in own},
        "B": {name: line for name, line in b.items() if name in own},
        "difference": {name: _difference(a[name], b[name]) for name in differing},
    }


def _difference(a: Line, b: Line) -> Line:
    at, in_a, in_b = np.intersect1d(a[0], b[0], return_indices=True)
    with np.errstate(invalid="ignore", over="ignore"):
        return at, b[1][in_b] - a[1][in_a]


def _log(recording: rr.RecordingStream, which: str, name: Name, time_s: FloatArray, values: FloatArray) -> None:
    entity, tint = standing(which, name), TINTS[which]
    has_unit = name[1] in CHANNELS and "/levels/" not in name[0]  # levels are shares of their thresholds
    unit = f" ({CHANNELS[name[1]].unit})" if has_unit else ""
    label = {"both": "A = B", "difference": "B - A"}.get(which, which) + f": {name[1]}{unit}"
    if len(time_s) and isinstance(time_s[0], str):  # lags
        lags = np.array([float(lag.removeprefix("lag ")) for lag in time_s])
        recording.log(entity, rr.BarChart(values, abscissa=lags, color=rgb(tint)), static=True)
    elif len(time_s) == 1:
        up, down = rr.components.MarkerShape.Up, rr.components.MarkerShape.Down
        shape = up if name[1] == "onset" else down
        log_mark(recording, entity, float(time_s[0]), float(values[0]), label, tint, shape)
    elif len(time_s):
        log_lines(recording, entity, time_s, values, [label], [tint], width=_WIDTHS.get(which, 1.5))


def _log_events(recording: rr.RecordingStream, a: pd.DataFrame, b: pd.DataFrame) -> None:
    of_a, of_b = events(a), events(b)
    told = {"both": of_a & of_b, "only A": of_a - of_b, "only B": of_b - of_a}
    rows = [(event[1], which, event) for which, of in told.items() for event in of.elements()]
    for time_s, which, (entity, _, level, text) in sorted(rows):
        trial = "/".join(word for word in entity.split("/") if word not in ("", "detectors", "trials", "events"))
        set_time(recording, time_s)
        recording.log("/events", rr.TextLog(f"{which}: {trial} {text}" if trial else f"{which}: {text}", level=level))


def _summary(found: Comparison, names: tuple[str, str]) -> str:
    """Return what differs as a page of Markdown."""
    page = [f"**A** `{names[0]}`", f"**B** `{names[1]}`"]
    if found.equal:
        return "\n\n".join([*page, "The two are equal, so only one of each series is shown."])
    page.append(
        f"{len(found.lines)} of {found.series} series differ; the greatest differences over the greatest value:"
    )
    page.append(_table(["series", "relative", "at"], [_worst(line) for line in found.lines]))
    page.append(f"{len(found.verdicts)} of {found.fields} fields of verdicts differ:")
    fields = [[f"`{one.entity}`", one.field, str(one.a), str(one.b)] for one in found.verdicts]
    page.append(_table(["verdict", "field", "A", "B"], fields))
    page.append(f"{len(found.only_a)} series and fields only in A, {len(found.only_b)} only in B")
    return "\n\n".join(page)


def _worst(line: LineDifference) -> list[str]:
    worst = line.worst
    at = "" if worst is None else worst.at if isinstance(worst.at, str) else f"{worst.at:g} s"
    return [f"`{line.entity}` {line.series}", f"{line.relative:.2g}", at]


def _table(columns: list[str], rows: list[list[str]]) -> str:
    written = [columns, ["---"] * len(columns), *rows[:_MOST_WORDS]]
    return "\n".join(f"| {' | '.join(words)} |" for words in written)
