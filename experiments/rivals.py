"""Rivals of the literature and our banks on the same flights: who sees what, how soon, at what price in false alarms.

    python experiments/rivals.py [--quick] [--out DIR] [--jobs N] [--late-s SECONDS] [--only NAME ...]

Every detector of `docs/explanation/rivals.md`, the banks and the dissertation's operator are calibrated on the same
flights (multisine and turbulence, the T2's noise), for 0.002 false alarms an hour each; the operator, tied to its
excitation, on two healthy records of each flight that it watches. Then they watch the same faults of gyros on flights
of another excitation (doublets and turbulence), and hours of healthy flight. --late-s: every attitude comes so late, in
calibration, too. Writes report.md and every row into DIR; prints the tables. It has no target: it shows whoever wins.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import chi2

import gtmbench as gb
from gtmbench.channels import COMMANDS, SENSORS
from gtmbench.detectors.protocol import Monitor
from gtmbench.detectors.rivals.catalogue import RIVALS
from gtmbench.detectors.statistics.thresholds import rate_bound
from gtmbench.errors import InputError
from gtmbench.processes import spread
from gtmbench.progress import Progress
from gtmbench.report.campaign import Campaign, Findings, conducted
from gtmbench.report.tables.markdown import grouped, markdown, share_text
from gtmbench.study.fault_tables import build, fault_specs, resolve
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.score import false_alarms

CALIBRATION, UNSEEN = "multisine+turbulence", "doublets+turbulence"
HEALTHY = (UNSEEN, "dissertation+turbulence", CALIBRATION, "doublets")
CALIBRATION_SEED, FAULT_SEED, HEALTHY_SEED = 1_900_001, 1_910_001, 1_920_001  # nobody used them while building
RATE = 0.002  # false alarms an hour
DISSERTATION = "dissertation"
DETECTORS = ("C", "C-early", "B", DISSERTATION, *RIVALS)
GYROS, ANGLES = ("p", "q", "r"), ("phi", "theta", "psi")
NOISE = {gyro: 3.0 * deviation for gyro, deviation in zip(GYROS, (0.535, 0.474, 0.34), strict=True)}
FAULTS: dict[str, dict[str, object]] = {
    "drift": {"slope": 0.05},
    "deadzone": {"half_width": "50 % of rms"},
    "saturation": {"limit": "40 % of peak"},
    "rate_saturation": {"rate_limit": "20 % of slew"},
    "jam": {},
    "bias": {"size": 1.0},
    "scale_factor": {"factor": 0.7},
    "noise": {"seed": 1},  # thrice the T2's, added
    "oscillation": {"amplitude": 1.0, "frequency_hz": 2.0},
}

Row = dict[str, object]


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much is flown, in flights and seconds, and by whom it is watched."""

    calibration: int = 30
    calibration_s: float = 300.0
    faults: int = 6
    duration_s: float = 200.0
    onset_s: float = 100.0
    healthy: int = 32
    healthy_s: float = 500.0
    gyros: Sequence[str] = GYROS
    kinds: Sequence[str] = tuple(FAULTS)
    detectors: Sequence[str] = DETECTORS
    late_s: float = 0.0


QUICK = Size(
    calibration=3,
    calibration_s=70.0,
    faults=1,
    duration_s=90.0,
    onset_s=60.0,
    healthy=1,
    healthy_s=70.0,
    gyros=("q",),
    kinds=("jam",),
    detectors=("C", DISSERTATION, "pca", "kinematic-kalman"),
)


def late(record: gb.Record, late_s: float) -> gb.Record:
    """Return a record whose attitude comes late."""
    for angle in ANGLES if late_s else ():
        record = gb.inject(record, gb.Delay(channel=angle, onset_s=record.start_s, delay_s=late_s))
    return record


def calibrated(size: Size, jobs: int, tell: Progress) -> dict[str, Monitor]:
    """Calibrate all but the one that is tied to its excitation, on the same flights."""
    flights = CalibrationFlights(
        flights=size.calibration, duration_s=size.calibration_s, excitation=CALIBRATION, seed=CALIBRATION_SEED
    )
    sensed = flights.sensed((*SENSORS, *COMMANDS), processes=jobs, progress=tell)
    records = [late(record, size.late_s) for record in sensed]
    names = [name for name in size.detectors if name != DISSERTATION]
    monitors: dict[str, Monitor] = {}
    for done, name in enumerate(names):
        tell(f"calibrate {name}", done, len(names))
        monitors[name] = gb.find_detector(name).calibrate(records, RATE)
    return monitors


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A flight that calibration never saw; healthy, or broken by every fault of every gyro in turn."""

    seed: int
    excitation: str
    is_healthy: bool
    size: Size
    monitors: Mapping[str, Monitor]

    def rows(self) -> list[Row]:
        """Fly, and return a row a detector (and fault)."""
        size, duration_s = self.size, self.size.healthy_s if self.is_healthy else self.size.duration_s
        flight = gb.fly("gtm", self.excitation, duration_s, self.seed)
        own = [gb.measure(flight, noise="t2", seed=self.seed + extra, commands=True) for extra in (0, 500_000, 700_000)]
        healthy, *others = (late(record, size.late_s) for record in own)
        monitors = dict(self.monitors)
        if DISSERTATION in size.detectors:
            monitors[DISSERTATION] = gb.find_detector(DISSERTATION).calibrate(others)
        what: Row = {"seed": self.seed, "excitation": self.excitation}
        ordered = {name: monitors[name] for name in size.detectors}
        told = self._false_alarms if self.is_healthy else partial(self._verdicts, flight)
        return [what | row for row in told(healthy, ordered)]

    def _false_alarms(self, healthy: gb.Record, monitors: Mapping[str, Monitor]) -> Iterator[Row]:
        for name, monitor in monitors.items():
            began = time.process_time()
            watch = monitor.watch(healthy)
            took_s = time.process_time() - began
            yield {
                "detector": name,
                "false_alarms": len(false_alarms(watch)),
                "hours": watch.armed_hours,
                "cpu": took_s / (healthy.end_s - healthy.start_s),
            }

    def _verdicts(self, flight: gb.Record, healthy: gb.Record, monitors: Mapping[str, Monitor]) -> Iterator[Row]:
        for fault in self._faults(flight):
            broken = gb.inject(healthy, fault)
            for name, monitor in monitors.items():
                verdict = gb.score(monitor.watch(broken), fault=fault, healthy=healthy, broken=broken)
                yield {
                    "detector": name,
                    "fault": fault.kind,
                    "channel": fault.channel,
                    "delay_s": np.inf if verdict.detection_delay_s is None else verdict.detection_delay_s,
                    "right": bool(verdict.isolated),
                    "wrong": bool(verdict.named_wrong),
                    "names": bool(monitor.suspects),
                }

    def _faults(self, flight: gb.Record) -> Iterator[gb.Fault]:
        """Give faults; a severity's share is one of what the gyro does while it is broken."""
        onset_s, end_s = self.size.onset_s, self.size.duration_s
        broken = flight.between(onset_s, end_s)
        for channel in self.size.gyros:
            for kind in self.size.kinds:
                figures = FAULTS[kind] | ({"deviation": NOISE[channel]} if kind == "noise" else {})
                (spec,) = fault_specs(kind, {"kind": kind, "channels": [channel], "onset_s": onset_s, **figures}, end_s)
                shares = spec.severities.items()
                yield build(spec, {name: resolve(share, broken, channel) for name, share in shares})


def flights(size: Size, monitors: Mapping[str, Monitor]) -> list[Flight]:
    """Return what is to be flown."""
    fly = partial(Flight, size=size, monitors=monitors)
    broken = [fly(seed=FAULT_SEED + i, excitation=UNSEEN, is_healthy=False) for i in range(size.faults)]
    healthy = [
        fly(seed=HEALTHY_SEED + i, excitation=HEALTHY[i % len(HEALTHY)], is_healthy=True) for i in range(size.healthy)
    ]
    return broken + healthy


# ---- the report ----


def percentile(share: float, delays_s: pd.Series) -> str:
    """Return a percentile of delays, one that was measured; what was missed is infinitely late."""
    found = float(np.percentile(delays_s, share, method="higher"))
    return f"{found:.2f}" if np.isfinite(found) else "missed"


def false_alarms_text(rows: pd.DataFrame) -> str:
    """Say how many there were in how long, and how many an hour that bounds (95 %, Poisson)."""
    count, hours = int(rows["false_alarms"].sum()), float(rows["hours"].sum())
    return f"{count} in {hours:.1f} h, at most {rate_bound(count, hours) or np.inf:.2g} an hour"


def keeps_text(rows: pd.DataFrame) -> str:
    """Say whether the rate asked for can be true: whether so many false alarms are at least as likely as 5 %."""
    count, hours = int(rows["false_alarms"].sum()), float(rows["hours"].sum())
    least = float(chi2.ppf(0.05, 2 * count)) / (2.0 * hours) if count else 0.0
    return f"no, at least {least:.2g} an hour" if least > RATE else "not refuted"


def table(healthy: pd.DataFrame, faults: pd.DataFrame) -> pd.DataFrame:
    """Return a line a detector, the most detected first, then the soonest."""
    of_healthy = dict(iter(healthy.groupby("detector", sort=False)))

    def named(rows: pd.DataFrame, column: str) -> str:
        found = rows[np.isfinite(rows["delay_s"])]
        return f"{100 * found[column].mean():.0f} %" if rows["names"].any() and len(found) else "-"

    def healthy_of(rows: pd.DataFrame) -> pd.DataFrame:
        return of_healthy[str(rows["detector"].iloc[0])]

    lines = grouped(
        faults,
        {"detector": "detector"},
        {
            "detected": lambda rows: share_text(int(np.isfinite(rows["delay_s"]).sum()), len(rows)),
            "median (s)": lambda rows: percentile(50, rows["delay_s"]),
            "95 % (s)": lambda rows: percentile(95, rows["delay_s"]),
            "named right": lambda rows: named(rows, "right"),
            "named wrong": lambda rows: named(rows, "wrong"),
            "false alarms": lambda rows: false_alarms_text(healthy_of(rows)),
            f"keeps {RATE:g} an hour": lambda rows: keeps_text(healthy_of(rows)),
            "CPU (ms a second of flight)": lambda rows: f"{1000 * healthy_of(rows)['cpu'].median():.2f}",
        },
    )
    ranks = faults.groupby("detector", sort=False)["delay_s"].agg(
        missed=lambda delays: np.isinf(delays).sum(), median="median"
    )
    order = [*ranks.sort_values(["missed", "median"], kind="stable").index]
    return lines.sort_values("detector", key=lambda names: names.map(order.index), kind="stable")


def kinds_table(faults: pd.DataFrame, order: Sequence[str]) -> pd.DataFrame:
    """Return a line a detector, a column a kind: how many of its faults were detected, and their median delay."""
    lines = []
    for name in order:
        own = faults[faults["detector"] == name]
        line = {"detector": name}
        for kind, rows in own.groupby("fault", sort=False):
            found = rows["delay_s"][np.isfinite(rows["delay_s"])]
            line[str(kind)] = f"{len(found)}" + (f", {found.median():.2f} s" if len(found) else "")
        lines.append(line)
    return pd.DataFrame(lines)


def report(healthy: pd.DataFrame, faults: pd.DataFrame, size: Size) -> str:
    """Return the report as Markdown."""
    lines = table(healthy, faults)
    by_excitation = grouped(
        healthy[healthy["false_alarms"] > 0],
        {"detector": "detector", "excitation": "excitation"},
        {"false alarms": lambda rows: int(rows["false_alarms"].sum())},
    )
    trials = len(size.gyros) * size.faults
    return f"""# Rivals on equal flights

{SAID_QUICK if size.calibration == QUICK.calibration else ""}Calibrated on the same {size.calibration} flights of
{size.calibration_s:g} s ({CALIBRATION}, T2 noise), every third of which fits the models and the others set the
thresholds, for {RATE:g} false alarms an hour of each detector; the dissertation's operator is calibrated on two healthy
records of each flight that it watches. {len(size.kinds)} kinds of faults of {len(size.gyros)} gyros on {size.faults}
flights ({UNSEEN}), {size.healthy} healthy flights of {size.healthy_s:g} s
({", ".join(HEALTHY)} in turn). The attitude is {f"{1000 * size.late_s:g} ms late" if size.late_s else "on time"}.
Seeds from {CALIBRATION_SEED}, {FAULT_SEED} and {HEALTHY_SEED} on: nobody used them while building.

Delays are from the onset to the first alarm, look-ahead and windows counted; what is missed is infinitely late. Named
right and wrong are shares of what is detected; the rest is left undecided; a dash: it names no sensor. Banks judge up
to 20 s after an alarm, rivals after 1 s. Intervals are 95 % (Clopper-Pearson), bounds on rates 95 % (Poisson, exact).
Who doesn't keep the rate asked for sees more than its due.

{markdown(lines)}

## Kind by kind

Detected of {trials}, and the median delay of these.

{markdown(kinds_table(faults, list(lines["detector"])))}

## False alarms, flight by flight

{markdown(by_excitation) if len(by_excitation) else "None."}
"""


SAID_QUICK = "**Quick: one short flight and a jam only. It shows that the script runs, and bounds nothing.**\n\n"


def conduct(campaign: Campaign) -> Findings:
    """Calibrate, fly, report."""
    unknown = [name for name in campaign.given.only or () if name not in DETECTORS]
    if unknown:
        raise InputError(f"--only {unknown[0]}: there are {', '.join(DETECTORS)}")
    base = QUICK if campaign.quick else Size()
    size = Size(
        **{**vars(base), "late_s": campaign.given.late_s, "detectors": tuple(campaign.given.only or base.detectors)}
    )
    planned = flights(size, calibrated(size, campaign.jobs, campaign.tell))
    rows = spread(Flight.rows, planned, processes=campaign.jobs, step="flights", progress=campaign.tell)
    parts: dict[bool, list[Row]] = {True: [], False: []}
    for flight, own in zip(planned, rows, strict=True):
        parts[flight.is_healthy].extend(own)
    healthy, faults = pd.DataFrame(parts[True]), pd.DataFrame(parts[False])

    def write(out: Path) -> None:
        healthy.drop(columns="cpu").to_csv(out / "healthy.csv", index=False)
        faults.to_csv(out / "faults.csv", index=False)

    return Findings(report(healthy, faults, size), False, write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what else may be given."""
    parser.add_argument("--late-s", type=float, default=0.0, help="by how much the attitude comes late")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="detectors (default: all)")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one short flight", arguments=arguments))
