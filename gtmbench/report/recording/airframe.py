"""The recording of an airframe: each constant over its flights, a flight a second.

=============================================  ================================================
entity                                         holds
=============================================  ================================================
``/AIRFRAME/SENSOR/CONSTANT/value``            what each flight tells
``/AIRFRAME/SENSOR/CONSTANT/low``, ``high``    between which it lies with 95 %
``/AIRFRAME/SENSOR/CONSTANT/limit``            which a slow change will reach
=============================================  ================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun.blueprint as rrb

from gtmbench.history.entry import Entry
from gtmbench.history.overview import Overview, overviews_of
from gtmbench.report.recording.blueprint import opened, plot
from gtmbench.report.recording.entities import entity, lighter, log_line, recorded
from gtmbench.report.style import COLOURS

_MOST = 12  # constants that are open at once


def write_airframe_recording(airframes: Mapping[str, Sequence[Entry]], path: Path) -> None:
    """Write constants over flights with a blueprint, the worst first."""
    shown = {
        entity(entity(entity("", name), each.sensor), each.name): each
        for name, flights in airframes.items()
        for each in overviews_of(flights)
    }
    with recorded(path, f"gtmbench history: {', '.join(airframes)}", _blueprint(shown)) as recording:
        for root, each in shown.items():
            time_s, colour = each.flights.astype(np.float64), COLOURS["p"]
            log_line(recording, f"{root}/value", (time_s, each.values), each.title, colour)
            for place, name in enumerate(("low", "high")):
                line = (time_s, each.intervals[:, place])
                log_line(recording, f"{root}/{name}", line, f"{name} of 95 %", lighter(colour))
            if each.trend is not None:
                limit = (time_s[[0, -1]], np.full(2, each.trend.limit))
                log_line(recording, f"{root}/limit", limit, "limit", COLOURS["threshold"])


def _blueprint(shown: Mapping[str, Overview]) -> rrb.Blueprint:
    flights = max((int(each.flights[-1]) for each in shown.values()), default=1)
    plots = [plot(each.title, [f"{root}/**"], (1.0, float(flights))) for root, each in [*shown.items()][:_MOST]]
    return opened(rrb.Grid(*plots, name="Constants over flights: a flight a second"))
