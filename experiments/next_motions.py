"""What to fly next, flown: whether a sensor is then judged to what was said.

    python experiments/next_motions.py [--logs N] [--seed N] [--quick] [--jobs N] [--out DIR]

Simulated flights of the GTM that leave sensors open: too short, hardly moving, or asked for a factor. Each motion that
`gtmbench monitor` names for them is flown in turbulence by an autopilot that holds bank and pitch as the motion says,
with another seed, and the log of it is judged as any other. A sensor is right if it is judged for as much of the time
as was asked, and clear up to what was said. Ends with code 1 where the target is missed (never with --quick).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.autopilot import Trim
from gtmbench.bench.sensor_readings import Readings
from gtmbench.history.next_motion import Manoeuvre
from gtmbench.jobs.processes import spread
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.markup import markdown
from studies.conduct import Campaign, Findings, conducted
from studies.targets import Target, held, is_missed

SORTS = ("short", "calm", "factor")
FACTOR = "factor=0.7"
ESTIMATORS = ("own", "own", "kalman")  # the attitude's sources
_SPEED_M_S, _GTM_M_S, _G_M_S2 = 20.0, 70.0, 9.81  # for which a motion's bank is stated; of the GTM
Row = dict[str, Any]


@dataclass(kw_only=True)
class Autopilot:
    """Holds bank and pitch as a motion says; level without one."""

    motion: Manoeuvre | None
    level: dict[str, float] = field(default_factory=dict)
    theta: float = float("nan")

    def start(self, trim: Trim) -> None:
        """Remember the steady flight it begins in."""
        self.level, self.theta = dict(trim.commands), float("nan")

    def command(self, readings: Readings, time_s: float) -> Sequence[float]:
        """Return elevator, aileron, rudder and throttle."""
        if np.isnan(self.theta):
            self.theta = readings.theta
        phi, theta, _ = (0.0, 0.0, 0.0) if self.motion is None else self.motion.angles(np.array([time_s]))[0]
        if self.motion is not None and self.motion.axes[2]:  # the bank of the same turn at its own speed
            phi += self._bank(_GTM_M_S) - self._bank(_SPEED_M_S)
        level = self.level
        elevator = level["elevator"] + (readings.theta - theta - self.theta) + 0.4 * readings.q
        aileron = level["aileron"] + 0.6 * (readings.phi - phi) + 0.15 * readings.p
        return elevator, aileron, level["rudder"], level["throttle"]

    def _bank(self, speed_m_s: float) -> float:
        assert self.motion is not None
        turn = np.radians(self.motion.rate_deg_s) * speed_m_s / _G_M_S2
        return float(np.degrees(np.arctan(np.minimum(turn, 1.0))))  # 45 deg at most


def watched(
    motion: Manoeuvre | None, duration_s: float, seed: int, sort: str, attitude: str, folder: Path
) -> WatchedLog:
    """Fly, write a log, watch it."""
    calm = sort == "calm" and motion is None
    excitation: Any = gb.Excitation() if calm else "turbulence"
    flight = gb.fly_in_loop("gtm", excitation, duration_s, seed, controller=Autopilot(motion=motion), attitude=attitude)
    path = folder / f"{seed}.csv"
    gb.write_log(flight.sensed, path)
    how = "own" if attitude == "own" else "driven"
    return gb.watch_log(path, "auto", attitude=how, limits=[FACTOR] if sort == "factor" else [])


def rows_of(number: int, seed: int) -> list[Row]:
    """Fly a log, then every motion that is named for it; return a row each sensor that was promised."""
    random = np.random.default_rng([seed, number])
    sort = SORTS[number % len(SORTS)]
    attitude = "own" if sort == "factor" else str(random.choice(ESTIMATORS))
    duration_s = float(random.uniform(16.0, 40.0)) if sort != "factor" else 60.0
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        first = watched(None, duration_s, 1000 * seed + number, sort, attitude, Path(folder))
        about = {"log": number, "sort": sort, "attitude": attitude, "open": len(first.verdict.unjudged)}
        for place, each in enumerate(first.next_motions, 1):
            again_seed = 1000 * seed + 500 + 10 * number + place
            again = watched(each.motion, each.motion.duration_s, again_seed, sort, attitude, Path(folder))
            for sensor, said in each.sizes.items():
                sizes = again.verdict.sizes_of(sensor)
                is_judged = sensor not in again.verdict.unjudged and sizes is not None
                error = sizes.error if sizes is not None else np.inf
                why = "" if is_judged else next(iter(again.verdict.reasons_of(sensor)), "")
                right = is_judged and error <= said
                rows.append(
                    about
                    | {"sensor": sensor, "motion": each.motion.text, "said": said, "found": error, "right": right}
                    | {"why": why}
                )
    return rows or [about]


def report(rows: pd.DataFrame) -> tuple[list[str], bool]:
    """Return the report's tables, and whether the target is missed."""
    told = rows[rows["sensor"].notna()] if "sensor" in rows else rows.iloc[:0]
    named = rows.groupby("log").agg(sort=("sort", "first"), open=("open", "first"))
    named["told"] = told.groupby("log").size() if len(told) else 0
    named = named.fillna(0).groupby("sort").sum().reset_index()
    by = told.groupby(["sort", "attitude"]).agg(sensors=("right", "size"), right=("right", "mean"))
    targets = [Target("what to fly next, flown: judged to what was said", "", "right", ">=", 0.95)]
    figures = {"": {"right": float(told["right"].astype(float).mean())}}
    motions = told.groupby("motion").agg(sensors=("right", "size"), right=("right", "mean"))
    wrong = told[~told["right"].astype(bool)][["log", "sort", "attitude", "sensor", "motion", "said", "found", "why"]]
    text = [
        "## Target",
        markdown(held(targets, figures)),
        "## Sensors that were open, and for how many a motion was named",
        markdown(named),
        "## Flown",
        markdown(by.round(3).reset_index()),
        markdown(motions.round(3).reset_index()),
        "## Not as said",
        markdown(wrong.round(2)) if len(wrong) else "None.",
    ]
    return text, is_missed(targets, figures)


def conduct(campaign: Campaign) -> Findings:
    """Fly, judge, report."""
    given = campaign.given
    work: Callable[[int], list[Row]] = partial(rows_of, seed=given.seed)
    logs = 3 if campaign.quick else given.logs
    done: Sequence[list[Row]] = spread(work, range(logs), processes=campaign.jobs, step="logs", progress=campaign.tell)
    rows = pd.DataFrame([row for own in done for row in own])
    text, missed = report(rows)
    quick = ["**Quick: three logs. It shows that the script runs, and bounds nothing.**"]
    head = ["# What to fly next", *(quick if campaign.quick else []), str(__doc__).partition("\n\n")[2]]

    def write(out: Path) -> None:
        rows.to_csv(out / "rows.csv", index=False)

    return Findings("\n\n".join([*head, *text]) + "\n", missed, write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add how much is flown."""
    parser.add_argument("--logs", type=int, default=30, help="simulated (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=74, help="of all draws (default: %(default)s)")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="three logs", arguments=arguments))
