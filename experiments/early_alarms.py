"""Alarms that don't wait: bank C-early beside bank C, on flights that calibration never saw, attitude late or not.

    python experiments/early_alarms.py [--quick] [--out DIR] [--jobs N]

Bank C waits 0.11 s until it knows what a gyro should have read. Bank C-early has its residuals and, beside them, those
of the attitude's body rates from the gyros, which wait for a sample. Calibrates both on GTM flights (multisine and
turbulence, the T2's noise), with the attitude as it is and 30 ms late. Then counts false alarms on healthy flights of
every excitation, and times the first alarm of every fault of a gyro. What is said after it isn't asked here; the
diagnoses stand on the residuals of bank C in both. Writes report.md and every row into DIR; prints the tables, and ends
with code 1 where a target of `TARGETS` is missed (never with --quick, whose figures bound nothing).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.detectors.statistics.thresholds import rate_bound
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress
from gtmbench.report.markup import markdown
from gtmbench.study.fault_tables import build, fault_specs, resolve
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.score import first_after
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS
from studies.conduct import DETAILS, Campaign, Findings, conducted
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

CALIBRATION, CALIBRATION_SEED = "multisine+turbulence", 1
UNSEEN = ("doublets+turbulence", "dissertation+turbulence", "doublets")
FAULT_SEED, HEALTHY_SEED = 80_001, 81_001  # of flights that nobody used while building
BANKS = ("C", "C-early")
LATE_S = {"as it is": 0.0, "30 ms late": 0.03}
FAULTS: dict[str, tuple[dict[str, object], ...]] = {
    "drift": ({"slope": 0.01}, {"slope": 0.05}),
    "deadzone": ({"half_width": "25 % of rms"}, {"half_width": "50 % of rms"}),
    "saturation": ({"limit": "40 % of peak"}, {"limit": "20 % of peak"}),
    "rate_saturation": ({"rate_limit": "20 % of slew"}, {"rate_limit": "10 % of slew"}),
    "jam": ({},),
    "stuck": ({"value": 0.0},),
    "bias": ({"size": 0.3}, {"size": 2.0}),
    "scale_factor": ({"factor": 1.1}, {"factor": 1.3}),
    "lag": ({"lag_s": 0.03}, {"lag_s": 0.2}),
    "oscillation": ({"amplitude": 1.0, "frequency_hz": 1.5}, {"amplitude": 3.0, "frequency_hz": 1.5}),
    "noise": ({"deviation": 1.5, "seed": 1}, {"deviation": 4.0, "seed": 1}),
}

Row = dict[str, object]
Monitors = Mapping[tuple[str, str], BankMonitor]  # by bank, and how late its attitude is


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much is flown, in flights and seconds, and what breaks."""

    duration_s: float = 190.0
    onset_s: float = 100.0
    watched_from_s: float = 20.0
    calibration: int = 60
    calibration_s: float = 500.0
    healthy: int = 216  # 30 h
    faults: int = 12
    gyros: Sequence[str] = GYROS
    kinds: Sequence[str] = tuple(FAULTS)


QUICK = Size(
    duration_s=85.0,
    onset_s=55.0,
    watched_from_s=5.0,
    calibration=3,
    calibration_s=70.0,
    healthy=1,
    faults=1,
    gyros=("q",),
    kinds=("jam",),
)


def reading(seed: int, excitation: str, duration_s: float) -> gb.Record:
    """Fly healthy; return what the sensors read."""
    return gb.measure(gb.fly("gtm", excitation, duration_s, seed), noise="t2", seed=seed)


def late(record: gb.Record, late_s: float) -> gb.Record:
    """Return a record whose attitude comes late."""
    for angle in ATTITUDE if late_s else ():
        record = gb.inject(record, gb.Delay(channel=angle, onset_s=record.start_s, delay_s=late_s))
    return record


def calibrated(size: Size, jobs: int, tell: Progress) -> Monitors:
    """Calibrate both banks, with the attitude as it is and late."""
    flights = CalibrationFlights(
        flights=size.calibration, duration_s=size.calibration_s, excitation=CALIBRATION, seed=CALIBRATION_SEED
    )
    records = flights.sensed(SENSORS, processes=jobs, progress=tell)
    monitors = {}
    for attitude, late_s in LATE_S.items():
        healthy = [late(record, late_s) for record in records]
        for bank in BANKS:  # least squares of quick's few minutes, too
            monitors[bank, attitude] = gb.calibrate(healthy, bank=gb.load_bank(bank), estimator=gb.LeastSquares())
    return monitors


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A flight that calibration never saw; healthy, or broken by every fault of every gyro in turn."""

    seed: int
    excitation: str
    is_healthy: bool
    size: Size
    monitors: Monitors

    def rows(self) -> list[Row]:
        """Fly, and return a row a monitor (and fault)."""
        size = self.size
        if self.is_healthy:
            healthy = reading(self.seed, self.excitation, size.calibration_s)
            return [row for what, record in self._read(healthy) for row in self._false_alarms(what, record)]
        flight = gb.fly("gtm", self.excitation, size.duration_s, self.seed)
        healthy = gb.measure(flight, noise="t2", seed=self.seed)
        return [
            row | {"severity": severity}
            for what, record in self._read(healthy)
            for severity, fault in self._faults(flight)
            for row in self._alarms(what, gb.inject(record, fault), fault)
        ]

    def _read(self, healthy: gb.Record) -> Iterator[tuple[Row, gb.Record]]:
        for attitude, late_s in LATE_S.items():
            what: Row = {"seed": self.seed, "excitation": self.excitation, "attitude": attitude}
            yield what, late(healthy, late_s)

    def _faults(self, flight: gb.Record) -> Iterator[tuple[str, gb.Fault]]:
        """Give faults; a severity's share is one of what the gyro does while it is broken."""
        onset_s, end_s = self.size.onset_s, self.size.duration_s
        broken = flight.between(onset_s, end_s)
        for channel in self.size.gyros:
            for kind in self.size.kinds:
                for severity, figures in zip(("mild", "strong"), FAULTS[kind], strict=False):
                    block = {"kind": kind, "channels": [channel], "onset_s": onset_s, **figures}
                    (spec,) = fault_specs(kind, block, end_s)
                    shares = spec.severities.items()
                    yield severity, build(spec, {name: resolve(share, broken, channel) for name, share in shares})

    def _false_alarms(self, what: Row, record: gb.Record) -> Iterator[Row]:
        for bank in BANKS:
            alarms = bank_alarms(self.monitors[bank, str(what["attitude"])], record)
            yield what | {"bank": bank, "alarms": len(alarms), "hours": (record.end_s - record.start_s) / 3600.0}

    def _alarms(self, what: Row, record: gb.Record, fault: gb.Fault) -> Iterator[Row]:
        watched = record.between(self.size.watched_from_s, record.end_s)
        for bank in BANKS:
            alarms = bank_alarms(self.monitors[bank, str(what["attitude"])], watched)
            told = first_after(alarms, fault.onset_s)
            yield what | {
                "bank": bank,
                "channel": fault.channel,
                "fault": fault.kind,
                "delay_s": np.inf if told is None else told.time_s - fault.onset_s,
                "false_alarms": sum(alarm.time_s < fault.onset_s - 1e-9 for alarm in alarms),
            }


def flights(size: Size, monitors: Monitors) -> list[Flight]:
    """Return what is to be flown, the longest first."""
    fly = partial(Flight, size=size, monitors=monitors)
    everything = (CALIBRATION, *UNSEEN)
    broken = [
        fly(seed=FAULT_SEED + i, excitation=UNSEEN[i % len(UNSEEN)], is_healthy=False) for i in range(size.faults)
    ]
    healthy = [
        fly(seed=HEALTHY_SEED + i, excitation=everything[i % len(everything)], is_healthy=True)
        for i in range(size.healthy)
    ]
    return broken + healthy


# ---- the report ----


def percentile(share: float, rows: pd.DataFrame) -> float:
    """Return a percentile of the delays, one that was measured; what was missed is infinitely late."""
    return float(np.percentile(rows["delay_s"], share, method="higher"))


def false_alarms(rows: pd.DataFrame) -> str:
    """Say how many there were in how long, and how many an hour that bounds."""
    count, hours = int(rows["alarms"].sum()), float(rows["hours"].sum())
    return f"{count} in {hours:.1f} h (at most {rate_bound(count, hours) or np.inf:.2g} an hour)"


OF_FAULTS = {
    "detected": lambda rows: share_text(int(np.isfinite(rows["delay_s"]).sum()), len(rows)),
    "median (s)": lambda rows: f"{percentile(50, rows):.2f}",
    "90 % (s)": lambda rows: f"{percentile(90, rows):.2f}",
    "95 % (s)": lambda rows: f"{percentile(95, rows):.2f}",
}
WHO = {"attitude": "attitude", "bank": "bank"}


def figures_of(healthy: pd.DataFrame, faults: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return what the targets ask for."""
    found = {}
    for attitude, own in faults.groupby("attitude"):
        plain, early = (own[own["bank"] == bank] for bank in BANKS)
        found[str(attitude)] = {
            "false_alarms": int(healthy.loc[healthy["bank"] == "C-early", "alarms"].sum()),
            "earlier": percentile(50, plain) - percentile(50, early),
            "missed": int(np.isinf(early["delay_s"]).sum()) - int(np.isinf(plain["delay_s"]).sum()),
        }
    return found


TARGETS = (
    Target("no false alarm in 30 h (each)", "as it is", "false_alarms", "<=", 0),
    Target("an earlier median", "as it is", "earlier", ">=", 0.04),
    Target("an earlier median, attitude 30 ms late", "30 ms late", "earlier", ">=", 0.03),
    Target("no fault missed that bank C finds", "as it is", "missed", "<=", 0),
    Target("no fault missed that bank C finds, attitude 30 ms late", "30 ms late", "missed", "<=", 0),
)


def report(healthy: pd.DataFrame, faults: pd.DataFrame, size: Size) -> str:
    """Return the report as Markdown."""
    kinds = grouped(faults, {"fault": "fault", "severity": "severity", **WHO}, OF_FAULTS)
    return f"""# Alarms that don't wait

{SAID_QUICK if size is QUICK else ""}Banks C and C-early, calibrated on {size.calibration} flights of
{size.calibration_s:g} s ({CALIBRATION}, T2 noise), for 0.002 false alarms an hour each, with the attitude as it is and
late. Faults of gyros on {size.faults} flights of {size.duration_s:g} s
({", ".join(UNSEEN)} in turn), and healthy flights; none was used while
building. Delays count look-ahead and windows; intervals are 95 %.

## Targets

{markdown(held(TARGETS, figures_of(healthy, faults)))}

## Healthy flights

{markdown(grouped(healthy, WHO, {"false alarms": false_alarms}))}

## All faults

{markdown(grouped(faults, WHO, OF_FAULTS))}

False alarms before the onset: {int(faults["false_alarms"].sum())} in {len(faults)} trials.

{DETAILS}

{markdown(grouped(faults, {"excitation": "excitation", **WHO}, OF_FAULTS))}

## Fault by fault

{markdown(kinds)}
"""


SAID_QUICK = "**Quick: one short flight and jams only. It shows that the script runs, and bounds nothing.**\n\n"


def conduct(campaign: Campaign) -> Findings:
    """Fly, time, report."""
    size = QUICK if campaign.quick else Size()
    planned = flights(size, calibrated(size, campaign.jobs, campaign.tell))
    rows = spread(Flight.rows, planned, processes=campaign.jobs, step="flights", progress=campaign.tell)
    parts = {True: [], False: []}
    for flight, own in zip(planned, rows, strict=True):
        parts[flight.is_healthy].extend(own)
    healthy, faults = pd.DataFrame(parts[True]), pd.DataFrame(parts[False])
    ranks = {name: rank for rank, name in enumerate(FAULTS)}
    faults = faults.sort_values("fault", key=lambda kinds: kinds.map(ranks), kind="stable")

    def write(out: Path) -> None:
        healthy.to_csv(out / "healthy.csv", index=False)
        faults.to_csv(out / "faults.csv", index=False)

    return Findings(report(healthy, faults, size), is_missed(TARGETS, figures_of(healthy, faults)), write)


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one short flight"))
