"""Every kind of fault, on gyros and attitude sensors alike: what bank C finds, names and tells.

    python experiments/every_fault.py [--quick] [--again FLIGHTS --first-seed SEED] [--out DIR] [--jobs N]

Calibrates bank C on GTM flights (multisine and turbulence, the T2's noise), then breaks others, which calibration never
saw and nobody used while building: every kind at two severities, on p, q, r and phi, theta, psi in equal numbers, so
that blaming the gyro always doesn't pay. Then each family of hypotheses is left out in turn, and the faults of that
family are those that nobody wrote a hypothesis for. Last, the smallest fault of each kind that is found. Writes
report.md and every trial into DIR; prints the tables, and ends with code 1 where a target of `TARGETS` is missed (never
with --quick, whose figures bound nothing). With --again the monitor that ships meets every kind on a few flights of
other seeds, and the tables of the kinds that it knows are all.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import pandas as pd
import scipy.optimize  # noqa: F401  a diagnosis imports it when it first needs it, which isn't what is timed

import gtmbench as gb
from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.isolation.diagnosis import SAME
from gtmbench.detectors.monitor.alarms import AlarmLogic
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.detectors.protocol import Watch
from gtmbench.faults.registry import FAULTS, how_of
from gtmbench.faults.shape import CONSTANT
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress
from gtmbench.report.markup import markdown
from gtmbench.study.fault_tables import fault_specs
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.score import first_after, score
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS, axis_of, unit_of
from gtmbench.values.record import Span
from studies.conduct import DETAILS, Campaign, Findings, conducted
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

CALIBRATION, CALIBRATION_SEED = "multisine+turbulence", 1
UNSEEN = ("doublets+turbulence", "dissertation+turbulence", "doublets")

NEXT = {name: group[(i + 1) % 3] for group in (GYROS, ATTITUDE) for i, name in enumerate(group)}
JUDGED_S = 20.0  # after the alarm
FOUND_S = 60.0  # after the onset, for a small fault to be found,
FOUND = 5 / 6  # on this share of the flights

Figures = tuple[float, ...]  # mild, strong
Row = dict[str, Any]


class Kind(NamedTuple):
    """What is tried of a kind of fault: the family of hypotheses that knows it, and its figures, mild and strong.

    A family of "" is none: that finding needs no hypothesis.
    """

    family: str
    name: str = ""  # of the severity; without one, there is one figure, which isn't used
    gyro: Figures = (0.0,)
    angle: Figures = (0.0,)
    of: str = ""  # what the figures are percents of
    others: Mapping[str, object] = {}
    weaker: Callable[[float], float] = lambda figure: figure / 2.0
    is_graded: bool = True  # whether smaller figures tell of a smaller fault


def _kind(cls: type[gb.Fault]) -> Kind:
    """Return what is tried of a kind, as its class says; most mild figures are 2 to 6 times the least that is found."""
    shape, typical = cls.shape, cls.typical
    assert typical is not None
    numbers = [each.name for each in cls.parameters() if each.is_severity]
    name = next((each for each in numbers if shape is not None and each == shape.figure), "")
    settings = {each.name for each in cls.parameters() if each.is_required} - {name}
    fixed = {each: value for each, value in typical.shown.items() if each in settings and value not in GYROS}
    mild, strong = typical.gyro[0], typical.gyro[-1]

    def weaker(figure: float) -> float:
        """Return half of it; half of a wrong gain; twice a limit, which is reached less."""
        healthy = 0.0 if shape is None else shape.healthy
        return 2.0 * figure if 0.0 < strong < mild else healthy + (figure - healthy) / 2.0

    return Kind(
        family="" if shape is None else shape.family,
        name=name,
        gyro=typical.gyro,
        angle=typical.angle,
        of=f"% of {typical.of}" if typical.of else "",
        others=fixed,
        weaker=weaker,
        is_graded=how_of(cls.kind) not in CONSTANT,
    )


# Gyros: deg/s, attitude: deg; shares are of what the channel does on that flight while it is broken
KINDS: dict[str, Kind] = {
    kind: _kind(cls) for kind, cls in FAULTS.items() if cls.typical is not None and cls.typical.gyro
}
MILD, STRONG, ONLY = "mild", "strong", "-"


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much is flown, in flights and seconds, and what breaks."""

    duration_s: float = 190.0
    onset_s: float = 100.0
    watched_from_s: float = 20.0
    calibration: int = 60
    calibration_s: float = 500.0
    first_seed: int = 300_151
    flights: int = 12
    small: int = 6  # flights, the first, on which the smallest faults are looked for
    steps: int = 10  # of the ladder of magnitudes, down from the strong ones
    groups: Sequence[Sequence[str]] = (GYROS, ATTITUDE)
    kinds: Sequence[str] = tuple(KINDS)
    outside: bool = True  # whether each family of hypotheses is left out, too


QUICK = Size(
    duration_s=85.0,
    onset_s=55.0,
    watched_from_s=5.0,
    calibration=3,
    calibration_s=70.0,
    first_seed=101,  # what was held back stays so
    flights=1,
    small=1,
    steps=2,
    groups=(("q",), ("psi",)),
    kinds=("jam", "noise"),
)


# ---- what is flown, and breaks ----


def calibrated(size: Size, jobs: int, tell: Progress) -> BankMonitor:
    """Calibrate bank C."""
    flights = CalibrationFlights(
        flights=size.calibration, duration_s=size.calibration_s, excitation=CALIBRATION, seed=CALIBRATION_SEED
    )
    records = flights.sensed(SENSORS, processes=jobs, progress=tell)
    return gb.calibrate(records, bank=gb.load_bank("C"), estimator=gb.LeastSquares())  # of quick's few minutes, too


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A flight of the study, of which some channels break, one at a time; everything is done on it that is to be."""

    seed: int
    excitation: str
    channels: Sequence[str]
    with_small: bool
    size: Size
    monitor: BankMonitor

    def rows(self) -> list[Row]:
        """Fly, and return a row a trial."""
        flight = gb.fly("gtm", self.excitation, self.size.duration_s, self.seed)
        healthy = gb.measure(flight, noise="t2", seed=self.seed)
        rows = []
        for channel in self.channels:
            for name in self.size.kinds:
                kind = KINDS[name]
                for severity, figure in severities(kind, channel):
                    fault = self._fault(name, channel, figure, flight)
                    what = self._about(name, channel, severity, figure)
                    rows.extend(what | row for row in self._judged(kind, fault, healthy))
                if self.with_small and channel in GYROS and kind.name and kind.is_graded:
                    for figure in self._ladder(kind):
                        fault = self._fault(name, channel, figure, flight)
                        what = self._about(name, channel, "small", figure)
                        rows.append(what | {"part": "small"} | self._found(fault, healthy))
        return rows

    def _about(self, kind: str, channel: str, severity: str, figure: float) -> Row:
        return {
            "seed": self.seed,
            "excitation": self.excitation,
            "group": group_of(channel),
            "channel": channel,
            "fault": kind,
            "severity": severity,
            "figure": figure,
        }

    def _fault(self, name: str, channel: str, figure: float, flight: gb.Record) -> gb.Fault:
        span_s = (self.size.onset_s, self.size.duration_s)
        return fault_of(name, channel, figure, flight, span_s, seed=self.seed)

    def _ladder(self, kind: Kind) -> Iterator[float]:
        figure = kind.gyro[-1]
        for _ in range(self.size.steps):
            yield figure
            figure = kind.weaker(figure)

    def _broken(self, fault: gb.Fault, healthy: gb.Record) -> tuple[gb.Record, gb.Record]:
        span_s = (self.size.watched_from_s, self.size.duration_s)
        return healthy.between(*span_s), gb.inject(healthy, fault).between(*span_s)

    def _judged(self, kind: Kind, fault: gb.Fault, healthy: gb.Record) -> Iterator[Row]:
        """Give what is said of a fault as one of the catalogue, and as one of a family that is left out."""
        before, broken = self._broken(fault, healthy)
        for part, without in (("catalogue", ()), ("outside", (kind.family,))):
            if part == "catalogue" or (kind.family and self.size.outside):
                with diagnoses_timed() as cpu_s:
                    watch = self.monitor.watch(broken, without=without)
                kind_right = score(watch, fault=fault, healthy=before, broken=broken).kind_right_20s
                yield {"part": part, "kind": bool(kind_right)} | said(watch, fault, cpu_s)

    def _found(self, fault: gb.Fault, healthy: gb.Record) -> Row:
        """Say whether an alarm comes in time; what it means isn't asked."""
        _, broken = self._broken(fault, healthy)
        told = first_after(bank_alarms(self.monitor, broken), fault.onset_s)
        return {"found": told is not None and told.time_s <= fault.onset_s + FOUND_S}


def fault_of(name: str, channel: str, figure: float, flight: gb.Record, span_s: Span, *, seed: int) -> gb.Fault:
    """Return a fault that begins with a span; a share is one of what the channel does in it."""
    kind = KINDS[name]
    block: dict[str, Any] = {"kind": name, "channels": [channel], "onset_s": span_s[0], **kind.others}
    if kind.name:
        block[kind.name] = f"{figure:.12f} {kind.of}" if kind.of else figure
    others = {each.name for each in FAULTS[name].parameters()} - set(block)
    block |= {each: NEXT[channel] for each in ("axis", "other") if each in others}
    block |= {"seed": seed} if "seed" in others else {}
    (spec,) = fault_specs(name, block, span_s[1])
    (fault,) = spec.faults(flight.between(*span_s))
    return fault


def group_of(channel: str) -> str:
    """Return what kind of sensor a channel is."""
    return "gyro" if channel in GYROS else "attitude"


def severities(kind: Kind, channel: str) -> list[tuple[str, float]]:
    """Return names and figures of what is tried of a kind on a channel."""
    figures = kind.gyro if channel in GYROS else kind.angle
    return list(zip((MILD, STRONG) if len(figures) > 1 else (ONLY,), figures, strict=True))


def flights(size: Size, monitor: BankMonitor) -> list[Flight]:
    """Return what is to be flown, the longest first."""
    planned = [
        Flight(
            seed=size.first_seed + i,
            excitation=UNSEEN[i % len(UNSEEN)],
            channels=group,
            with_small=i < size.small,
            size=size,
            monitor=monitor,
        )
        for i in range(size.flights)
        for group in size.groups
    ]
    return sorted(planned, key=lambda flight: not flight.with_small)


# ---- what is said of a fault ----


@contextmanager
def diagnoses_timed() -> Iterator[dict[int, float]]:
    """Measure the CPU seconds of everything that is said of each alarm, all horizons together, by its number."""
    cpu_s: dict[int, float] = defaultdict(float)
    look_at = AlarmLogic._look_at

    def timed(logic: AlarmLogic, fault: Any) -> None:
        began = time.process_time()
        look_at(logic, fault)
        cpu_s[fault.alarm.number] += time.process_time() - began

    with patch.object(AlarmLogic, "_look_at", timed):
        yield cpu_s


def said(watch: Watch, fault: gb.Fault, cpu_s: Mapping[int, float]) -> Row:
    """Hold what a monitor said against the truth: the first alarm after the onset, as judged 20 s later."""
    told = first_after(watch.alarms, fault.onset_s)
    row: Row = {
        "detected": told is not None,
        "delay_s": np.inf if told is None else told.time_s - fault.onset_s,
        "false_alarms": sum(alarm.time_s < fault.onset_s - 1e-9 for alarm in watch.faults),
    }
    if told is None:
        return row | dict.fromkeys(SAID, False) | {"kind said": "", "verdict": "not detected", "cpu_s": np.nan}
    alarm = next(each for each in watch.alarms if each.number == told.fault)
    judged = alarm.at(told.time_s - alarm.time_s + JUDGED_S)
    named = None if judged is None else judged.sensor
    candidates = () if judged is None else judged.candidates
    axes = {name for channel in fault.changes for name in axis_of(channel)}
    is_right = named in fault.changes or is_same(judged, fault)
    last_s = watch.record.end_s - told.time_s
    return row | {
        "right": is_right,
        "wrong": named is not None and not is_right,
        "either-or": named is None and not is_right and bool(set(candidates) & set(fault.changes)),
        "axis": bool(candidates) and axes.issuperset(candidates),
        "passed": alarm.has_passed or not candidates,
        "ended": alarm.ended_s is not None,
        "kind said": (judged.kind if judged is not None else None) or "none",
        "verdict": " or ".join(candidates) or "passed",
        "cpu_s": cpu_s.get(alarm.number, np.nan) if last_s > FOUND_S and alarm.is_first else np.nan,
    }


SAID = ("right", "wrong", "either-or", "axis", "passed", "ended")


def is_same(judged: Judgement | None, fault: gb.Fault) -> bool:
    """Tell whether an either-or is all that can be said: a gyro's fault and its angle's are physically the same."""
    if judged is None or judged.sensor is not None or fault.channel not in judged.candidates:
        return False
    own = 0 if fault.channel in GYROS else 1
    on_axis = set(judged.candidates) <= set(axis_of(fault.channel))
    return on_axis and any(pair[own] == fault.kind for pair in SAME)


# ---- figures of merit ----

Cell = Callable[[pd.DataFrame], object]


def share(column: str) -> Cell:
    """Say of what share of the faults detected a column is true."""

    def cell(rows: pd.DataFrame) -> str:
        among = rows[rows["detected"]]
        return share_text(int(among[column].sum()), len(among))

    return cell


def count(column: str) -> Cell:
    """Say how often a column is true."""
    return lambda rows: int(rows[column].sum())


def taken_for(rows: pd.DataFrame) -> str:
    """Say what else a kind was called, most often first."""
    other = rows[rows["detected"] & ~rows["kind"]]["kind said"].value_counts()
    return ", ".join(f"{name} {times}" for name, times in other.head(3).items())


OVERALL: dict[str, Cell] = {
    "detected": lambda rows: share_text(int(rows["detected"].sum()), len(rows)),
    "median (s)": lambda rows: f"{np.median(rows['delay_s']):.2f}",
    "right": share("right"),
    "wrong": share("wrong"),
    "either-or": share("either-or"),
    "axis": share("axis"),
    "kind": share("kind"),
    "passed": count("passed"),
    "ended": count("ended"),
}
BY_KIND = OVERALL | {name: count(name) for name in ("wrong", "either-or", "axis")} | {"else called": taken_for}
OUTSIDE = {name: cell for name, cell in OVERALL.items() if name not in ("detected", "median (s)", "kind")}
OUTSIDE_BY_KIND = (
    {"detected": lambda rows: f"{rows['detected'].sum()} of {len(rows)}"} | OUTSIDE | {"called": taken_for}
)


def merits(rows: pd.DataFrame) -> dict[str, float]:
    """Return what the targets ask for; what is said of a fault, of those detected."""
    known, timed = rows[rows["detected"]], rows["cpu_s"].dropna()
    return {
        "detected": float(rows["detected"].mean()),
        **{name: float(known[name].mean()) for name in ("right", "wrong", "either-or", "axis", "kind")},
        "passed": int(rows["passed"].sum()),
        "ended": int(rows["ended"].sum()),
        "false alarms": int(rows["false_alarms"].sum()),
        "diagnosis_median_s": float(timed.median()),
        "diagnosis_worst_s": float(timed.max()),
    }


TARGETS = (
    Target("detected at least 99 %", "catalogue", "detected", ">=", 0.99),
    Target("kinds of the catalogue: right sensor at least 97 %", "catalogue", "right", ">=", 0.97),
    Target("kinds of the catalogue: wrong sensor at most 0.5 %", "catalogue", "wrong", "<=", 0.005),
    Target("kinds of the catalogue: kind right at least 90 %", "catalogue", "kind", ">=", 0.90),
    Target("kinds of the catalogue: never passed", "catalogue", "passed", "<=", 0),
    Target("kinds outside: right sensor at least 90 %", "outside", "right", ">=", 0.90),
    Target("kinds outside: wrong sensor at most 4 %", "outside", "wrong", "<=", 0.04),
    Target("kinds outside: axis right at least 99 %", "outside", "axis", ">=", 0.99),
    Target("kinds outside: never passed", "outside", "passed", "<=", 0),
    Target("a diagnosis: median at most 0.1 s of CPU", "catalogue", "diagnosis_median_s", "<=", 0.1),
    Target("a diagnosis: worst at most 0.5 s of CPU", "catalogue", "diagnosis_worst_s", "<=", 0.5),
)


# ---- the report ----


def report(rows: pd.DataFrame, figures: Mapping[str, Mapping[str, float]], size: Size) -> str:
    """Return the report as Markdown."""
    catalogue, outside = (rows[rows["part"] == part] for part in ("catalogue", "outside"))
    by_kind = {"fault": "fault", "severity": "given"}
    return f"""# Every fault

{SAID_QUICK if size is QUICK else ""}Bank C, calibrated on {size.calibration} flights of {size.calibration_s:g} s
({CALIBRATION}, T2 noise). Judged on {size.flights} flights of {size.duration_s:g} s, seeds {size.first_seed} and on,
that calibration never saw and nobody used while building: {", ".join(UNSEEN)}
in turn; every kind, on p, q, r, phi, theta and psi, from {size.onset_s:g} s on. Names are of those detected, as judged
{JUDGED_S:g} s after the alarm; *right* is the sensor that failed, or an either-or of an axis where their faults are
physically the same ({same_text()}), *axis* that all that are left lie on the axis that failed. Intervals
are 95 % (Clopper-Pearson).

## Targets

{markdown(held(TARGETS, figures))}

## All kinds

{table(catalogue, {"sensors": "group"}, OVERALL)}

{table(catalogue, {"sensor": "channel"}, OVERALL)}

{table(catalogue, {"excitation": "excitation"}, OVERALL)}

False alarms before the onset: {int(catalogue["false_alarms"].sum())} in {len(catalogue)} trials.

{DETAILS}

## Gyros, kind by kind

{table(of_group(catalogue, "gyro"), by_kind, BY_KIND)}

## Attitude, kind by kind

{table(of_group(catalogue, "attitude"), by_kind, BY_KIND)}

## Kinds that nobody wrote a hypothesis for

Each family of hypotheses was left out in turn and met its own faults, whose kind is then `unknown` at best.

{table(outside, {"left out": "family", "sensors": "group"}, OUTSIDE)}

Gyros:

{table(of_group(outside, "gyro"), by_kind, OUTSIDE_BY_KIND)}

Attitude:

{table(of_group(outside, "attitude"), by_kind, OUTSIDE_BY_KIND)}

## The smallest fault found

Found: an alarm within {FOUND_S:g} s of the onset, on at least five of six of the first {size.small} flights. Magnitudes
are a factor of 2 apart, from the strong ones above down; of a gain, how far it is from 1.

{markdown(smallest(rows[rows["part"] == "small"]))}

## What was missed

{misses(catalogue)}

With its family left out:

{misses(outside)}
"""


SAID_QUICK = "**Quick: one short flight and two kinds. It shows that the script runs, and bounds nothing.**\n\n"


def of_group(rows: pd.DataFrame, group: str) -> pd.DataFrame:
    """Return the trials of gyros, or of attitude sensors."""
    return rows[rows["group"] == group]


def same_text() -> str:
    """Name the faults of a gyro and its angle that are physically the same."""
    return "; ".join(f"a gyro's {gyro} and its angle's {angle}" for gyro, angle in sorted(SAME))


def table(rows: pd.DataFrame, by: Mapping[str, str], cells: Mapping[str, Cell]) -> str:
    """Return a line a group as Markdown."""
    return markdown(grouped(rows, by, cells)) if len(rows) else "None."


def given(row: Row) -> str:
    """Write a severity as it was given."""
    kind, figure = KINDS[row["fault"]], row["figure"]
    return row["severity"] if not kind.name else f"{row['severity']}, {figure_text(kind, figure, row['channel'])}"


def figure_text(kind: Kind, figure: float, channel: str) -> str:
    """Write a magnitude in its unit."""
    if kind.of:
        return f"{figure:.3g} {kind.of}"
    unit = unit_of(channel)
    own = {"scale_factor": "", "lag_s": "s", "delay_s": "s", "hold_s": "s", "angle_deg": "deg", "factor": ""}
    per = {"slope": " per s", "gain": " per sqrt(s)", "coefficient": " per g"}
    return f"{figure:.3g} {own.get(kind.name, unit + per.get(kind.name, ''))}".strip()


def smallest(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the smallest magnitude of every kind that is found on enough flights, gyro by gyro."""
    lines = []
    for fault, own in rows.groupby("fault", sort=False):
        kind = KINDS[str(fault)]
        line: Row = {"fault": fault}
        for channel, of in own.groupby("channel", sort=False):
            found = of.groupby("figure", sort=False)["found"].mean() >= FOUND  # from the strongest on
            enough = [float(figure) for figure in found.index[found.cumprod().astype(bool)]]
            line[str(channel)] = figure_text(kind, enough[-1], str(channel)) if enough else "none of those tried"
        lines.append(line)
    return pd.DataFrame(lines)


def misses(rows: pd.DataFrame) -> str:
    """List what was missed, named wrongly, or said to have passed or ended, with the flights that it happened on."""
    bad = rows[~rows["detected"] | rows["wrong"] | rows["passed"] | rows["ended"]]
    lines = []
    for (fault, given_, channel), own in bad.groupby(["fault", "given", "channel"], sort=False):
        what = [
            "passed" if row["passed"] else "said to have ended" if row["ended"] else row["verdict"]
            for row in own.to_dict("records")
        ]
        told = ", ".join(f"{text} ({what.count(text)})" for text in dict.fromkeys(what))
        seeds = ", ".join(map(str, own["seed"]))
        lines.append(f"- {str(fault).replace('_', ' ')} of {channel}, {given_}: {told}; flights {seeds}")
    return "\n".join(lines) or "None."


def conduct_again(campaign: Campaign) -> Findings:
    """Fly a few other flights, and judge the monitor that ships by the kinds that it knows."""
    size = Size(first_seed=campaign.given.first_seed, flights=campaign.given.again, small=0, outside=False)
    monitor = gb.load_monitor(Path(str(gb.__file__)).with_name("baselines") / "bank-C.json")
    assert isinstance(monitor, BankMonitor)
    flown = spread(Flight.rows, flights(size, monitor), processes=campaign.jobs, step="flights", progress=campaign.tell)
    rows = arranged([row for rows in flown for row in rows])
    parts = [
        f"# Every fault again\n\nThe monitor that ships, {size.flights} flights from seed {size.first_seed} on.",
        markdown(grouped(rows, {"sensors": "group"}, OVERALL)),
        DETAILS,
        markdown(grouped(rows, {"fault": "fault", "severity": "given", "sensors": "group"}, BY_KIND)),
    ]
    return Findings("\n\n".join(parts), missed=False, write=lambda out: rows.to_csv(out / "trials.csv", index=False))


def asked(parser: argparse.ArgumentParser) -> None:
    """Add what --again takes."""
    parser.add_argument("--again", type=int, metavar="FLIGHTS", help="so many other flights, the monitor that ships")
    parser.add_argument("--first-seed", type=int, default=992_001, help="the first of their seeds")


def conduct(campaign: Campaign) -> Findings:
    """Fly, judge, report."""
    if campaign.given.again:
        return conduct_again(campaign)
    size = QUICK if campaign.quick else Size()
    planned = flights(size, calibrated(size, campaign.jobs, campaign.tell))
    flown = spread(Flight.rows, planned, processes=campaign.jobs, step="flights", progress=campaign.tell)
    rows = arranged([row for rows in flown for row in rows])
    figures = {part: merits(rows[rows["part"] == part]) for part in ("catalogue", "outside")}

    def write(out: Path) -> None:
        (out / "figures.json").write_text(json.dumps(figures, indent=2) + "\n")
        rows.to_csv(out / "trials.csv", index=False)

    return Findings(report(rows, figures, size), is_missed(TARGETS, figures), write)


def arranged(rows: Sequence[Row]) -> pd.DataFrame:
    """Return all trials, kind by kind and channel by channel, with what the report says of them."""
    frame = pd.DataFrame(rows)
    frame["given"] = [given(row) for row in rows]
    frame["family"] = [KINDS[row["fault"]].family for row in rows]
    ranks = {
        "fault": list(KINDS),
        "channel": [*GYROS, *ATTITUDE],
        "severity": [MILD, STRONG, ONLY, "small"],
        "excitation": list(UNSEEN),
    }
    order = pd.DataFrame(
        {name: frame[name].map(values.index) for name, values in ranks.items()} | {"seed": frame["seed"]}
    )
    frame = frame.loc[order.sort_values(["fault", "severity", "channel", "seed"], kind="stable").index]
    flags = ["detected", "found", "kind", *SAID]
    return frame.assign(**{name: frame[name].eq(True) for name in flags if name in frame})


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one short flight, two kinds", beside="trials", arguments=asked))
