"""Other sensors and other tests: what `gtmbench campaign which_gyro` asks of bank C, where its sensors are worse.

    python experiments/other_sensors.py [--quick] [--out DIR] [--jobs N]

Calibrates monitors on GTM flights (multisine and turbulence, the T2's noise), then flies others (doublets and
turbulence, other seeds) and holds alarms and diagnoses against the truth: attitude from a filter that the faulty gyros
drive, imperfect sensors, other test statistics. Writes report.md, a figure and every trial into DIR; prints the tables,
and ends with code 1 where a target of `TARGETS` is missed (never with --quick, whose figures bound nothing).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.sensors import drawn
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.detectors.statistics.statistic import Statistic
from gtmbench.detectors.statistics.thresholds import rate_bound
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress
from gtmbench.report.figures.panels import panels
from gtmbench.report.markup import markdown
from gtmbench.study.fault_tables import build, fault_specs, resolve
from gtmbench.study.score import false_alarms, first_after, score
from gtmbench.values.channels import ATTITUDE, GYROS
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CALIBRATION, UNSEEN = "multisine+turbulence", "doublets+turbulence"
CALIBRATION_SEED, HEALTHY_SEED, FAULT_SEED = 1, 51_001, 72_001  # flights of one part are seen by no other

MILD, STRONG = "mild", "strong"
Grid = dict[str, dict[str, dict[str, object]]]  # of a kind, the severities by name
GYRO_FAULTS: Grid = {  # the milder severities are the targets' own
    "drift": {MILD: {"slope": 0.01}, STRONG: {"slope": 0.05}},
    "deadzone": {MILD: {"half_width": "25 % of rms"}, STRONG: {"half_width": "50 % of rms"}},
    "saturation": {MILD: {"limit": "40 % of peak"}, STRONG: {"limit": "20 % of peak"}},
    "rate_saturation": {MILD: {"rate_limit": "20 % of slew"}, STRONG: {"rate_limit": "10 % of slew"}},
    "jam": {STRONG: {}},
}
MAGNITUDES: Grid = {  # what imperfect sensors cost
    "drift": {f"{slope:g} deg/s²": {"slope": slope} for slope in (0.003, 0.01, 0.03, 0.1)},
    "deadzone": {f"{share} % of rms": {"half_width": f"{share} % of rms"} for share in (3, 6, 12, 25)},
}
JAM: Grid = {"jam": {STRONG: {}}}
DRIFT: Grid = {"drift": {"0.1 deg/s²": {"slope": 0.1}}}
IMPERFECT = {
    "perfect": gb.Imperfections(),
    "fair": gb.Imperfections(bias=0.5, wander=0.003, lag_s=0.002, quantum=0.02),
    "poor": gb.Imperfections(bias=2.0, wander=0.02, lag_s=0.005, quantum=0.1),
}
FILTERS_S = {"1 s": 1.0, "5 s": 5.0, "20 s": 20.0}  # time constants
TESTS = {
    "glr (bank C's own)": Statistic(),
    "cusum": Statistic(name="cusum", windows_s=(1.0,)),
    "whitened energy, 0.5 s": Statistic(name="whitened_energy", windows_s=(0.5,)),
    "E(k), 0.5 s": Statistic(name="energy", windows_s=(0.5,)),
    "E(k), 10 s (w = 1000)": Statistic(name="energy", windows_s=(10.0,)),
}
Row = dict[str, object]


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much is flown, in flights and seconds, and what breaks."""

    duration_s: float = 500.0
    onset_s: float = 300.0
    watched_s: tuple[float, float] = (60.0, 460.0)  # of a flight with a fault
    reference_s: tuple[float, float] = (25.0, 300.0)  # where severities are measured
    calibration: int = 24
    filters: int = 4
    imperfect_healthy: int = 12
    costs: int = 6
    gyros: Sequence[str] = GYROS
    gyro_faults: Grid = field(default_factory=lambda: GYRO_FAULTS)
    magnitudes: Grid = field(default_factory=lambda: MAGNITUDES)
    careless: Sequence[str] = ("fair", "poor")  # sensors that bank C wasn't calibrated for


QUICK = Size(
    duration_s=70.0,
    onset_s=55.0,
    watched_s=(5.0, 62.0),
    reference_s=(5.0, 55.0),
    calibration=3,
    filters=1,
    imperfect_healthy=1,
    costs=1,
    gyros=("q",),
    gyro_faults=JAM,
    magnitudes=DRIFT,
    careless=("fair",),
)


# ---- sensors, and monitors calibrated for them ----


class Sensors(NamedTuple):
    """The T2's sensors, the gyros as imperfect as told, the attitude from a filter that they drive where told."""

    imperfections: gb.Imperfections = IMPERFECT["perfect"]
    time_constant_s: float | None = None

    def measured(self, flight: gb.Record, seed: int) -> gb.Record:
        """Return what they read on a flight; the attitude isn't filtered yet."""
        return gb.imperfect(gb.measure(flight, noise="t2", seed=seed), self.imperfections, seed=seed)

    def filtered(self, record: gb.Record, flight: gb.Record, seed: int) -> gb.Record:
        """Return a record with the attitude its own gyros drive; the reference has 0.5 deg of noise."""
        if self.time_constant_s is None:
            return record
        for angle in ATTITUDE:
            record = record.replace(angle, flight[angle])
        return gb.filtered_attitude(record, time_constant_s=self.time_constant_s, reference_noise_deg=0.5, seed=seed)


T2 = Sensors()
OTHERS = {name: Sensors(imperfections=imperfections) for name, imperfections in IMPERFECT.items()} | {
    name: Sensors(time_constant_s=constant_s) for name, constant_s in FILTERS_S.items()
}


class Watcher(NamedTuple):
    """A monitor, and the sensors that it watches."""

    monitor: gb.Monitor
    sensors: Sensors = T2


def readings(flown: tuple[int, str, Sequence[Sensors]], duration_s: float) -> list[gb.Record]:
    """Fly healthy, and return what every set of sensors reads."""
    seed, excitation, sets = flown
    flight, records = gb.fly("gtm", excitation, duration_s, seed), []
    for sensors in sets:
        own = sensors._replace(imperfections=drawn(sensors.imperfections, seed=seed))
        records.append(own.filtered(own.measured(flight, seed), flight, seed))
    return records


def calibrated(size: Size, jobs: int, tell: Progress) -> dict[str, Watcher]:
    """Calibrate bank C for each kind of sensors, and with each test."""
    seeds = range(CALIBRATION_SEED, CALIBRATION_SEED + size.calibration)
    sets = [(seed, CALIBRATION, (T2, *OTHERS.values())) for seed in seeds]
    work = partial(readings, duration_s=size.duration_s)
    flown = spread(work, sets, processes=jobs, step="calibration flights", progress=tell)
    of_t2, *of_others = (list(own) for own in zip(*flown, strict=True))
    records = dict(zip(OTHERS, of_others, strict=True))
    c, filtered = gb.load_bank("C"), gb.load_bank("C-filtered")
    calibrate = partial(gb.calibrate, estimator=gb.LeastSquares())  # of quick's few minutes, too
    monitors = {name: calibrate(records[name], bank=c) for name in IMPERFECT}
    monitors |= {name: calibrate(records[name], bank=filtered) for name in FILTERS_S}
    monitors |= {name: calibrate(of_t2, bank=replace(c, statistic=test)) for name, test in TESTS.items()}
    watchers = {name: Watcher(monitor, OTHERS.get(name, T2)) for name, monitor in monitors.items()}
    for name in size.careless:
        watchers[f"perfect, on {name} sensors"] = Watcher(monitors["perfect"], OTHERS[name])
    return watchers


# ---- flights that calibration never saw ----


def judged(monitor: gb.Monitor, healthy: gb.Record, broken: gb.Record, fault: gb.Fault) -> Row:
    """Hold what a monitor says of a broken record against the truth; an alarm before the onset spoils what it says."""
    before = healthy.between(broken.start_s, broken.end_s)
    verdict = score(gb.watch(monitor, broken), fault=fault, healthy=before, broken=broken)
    is_clean = verdict.detected and not verdict.false_alarms
    return {
        "false_alarms": verdict.false_alarms,
        "detected": verdict.detected,
        "clean": is_clean,
        "delay_s": verdict.detection_delay_s if verdict.detected else np.inf,
        "isolated": is_clean and bool(verdict.isolated),
        "verdict": verdict.verdict,
    }


def alarmed(monitor: gb.Monitor, _healthy: gb.Record, broken: gb.Record, fault: gb.Fault) -> Row:
    """Say only when the alarm came: a first alarm doesn't wait for what is said of it, and nor does this."""
    alarms = bank_alarms(monitor, broken)
    told = first_after(alarms, fault.onset_s)
    return {
        "false_alarms": sum(alarm.time_s < fault.onset_s - 1e-9 for alarm in alarms),
        "detected": told is not None,
        "delay_s": np.inf if told is None else told.time_s - fault.onset_s,
    }


@dataclass(frozen=True, kw_only=True)
class Task:
    """A flight of a part of the study: who watches it, what breaks, and how that is judged; nothing: false alarms."""

    part: str
    seed: int
    size: Size
    watchers: Mapping[str, Watcher]
    channels: Sequence[str] = ()
    faults: Grid = field(default_factory=dict)
    judge: Callable[[gb.Monitor, gb.Record, gb.Record, gb.Fault], Row] = judged

    @property
    def cost(self) -> float:
        """About how long it takes, in diagnoses."""
        trials = len(self.channels) * sum(map(len, self.faults.values()))
        return len(self.watchers) * (trials if self.judge is judged else 0.2 * trials)

    def rows(self) -> list[Row]:
        """Fly, and return a row a monitor and fault."""
        flight = gb.fly("gtm", UNSEEN, self.size.duration_s, self.seed)
        faults, rows = list(self._faults(flight)), []
        for name, (monitor, sensors) in self.watchers.items():
            healthy, about = sensors.measured(flight, self.seed), {"monitor": name, "seed": self.seed}
            if not self.faults:
                watch = gb.watch(monitor, healthy)
                rows.append(about | {"alarms": len(false_alarms(watch)), "hours": watch.armed_hours})
            for severity, fault in faults:
                broken = self._driven(gb.inject(healthy, fault), flight, fault, sensors)
                what = {"severity": severity, "channel": fault.channel, "fault": fault.kind}
                rows.append(about | what | self.judge(monitor, healthy, broken, fault))
        return rows

    def _faults(self, flight: gb.Record) -> Iterator[tuple[str, gb.Fault]]:
        """Give every fault of every channel; its severity may be a share of what the channel does on this flight."""
        reference, onset_s = flight.between(*self.size.reference_s), self.size.onset_s
        for channel in self.channels:
            for kind, severities in self.faults.items():
                for severity, figures in severities.items():
                    block = {"kind": kind, "channels": [channel], "onset_s": onset_s, **figures}
                    (spec,) = fault_specs(kind, block, self.size.duration_s)
                    shares = spec.severities.items()
                    yield severity, build(spec, {name: resolve(share, reference, channel) for name, share in shares})

    def _driven(self, broken: gb.Record, flight: gb.Record, fault: gb.Fault, sensors: Sensors) -> gb.Record:
        """Return what is watched of a broken record: where its gyros drive a filter, up to where that tumbles."""
        start_s, end_s = self.size.watched_s
        for after_s in (end_s - fault.onset_s, 100.0, 60.0, 40.0):
            span_s = (start_s, min(end_s, fault.onset_s + after_s))
            try:
                return sensors.filtered(broken.between(*span_s), flight.between(*span_s), self.seed)
            except gb.InputError:
                continue
        raise gb.InputError(f"the attitude filter tumbles within 40 s of {fault}")


def tasks(size: Size, watchers: Mapping[str, Watcher]) -> list[Task]:
    """Return every flight of the study, the longest first so that no process waits for the last."""

    def flights(part: str, first: int, count: int, names: Sequence[str], **what: Any) -> list[Task]:
        watching = {name: watchers[name] for name in names}
        seeds = range(first, first + count)
        return [Task(part=part, seed=seed, size=size, watchers=watching, **what) for seed in seeds]

    careless = [name for name in watchers if name.startswith("perfect, on")]
    gyros: dict[str, Any] = {"channels": size.gyros, "faults": size.gyro_faults}
    small: dict[str, Any] = {"channels": size.gyros, "faults": size.magnitudes, "judge": alarmed}
    planned = [
        *flights("filters", FAULT_SEED, size.filters, tuple(FILTERS_S), **gyros),
        *flights("imperfect_healthy", HEALTHY_SEED, size.imperfect_healthy, (*IMPERFECT, *careless)),
        *flights("imperfect_faults", FAULT_SEED + 1000, size.costs, tuple(IMPERFECT), **small),
        *flights("tests", FAULT_SEED + 2000, size.costs, tuple(TESTS), **gyros, judge=alarmed),
    ]
    return sorted(planned, key=lambda task: -task.cost)


def flown(tasks: Sequence[Task], jobs: int, tell: Progress) -> dict[str, pd.DataFrame]:
    """Fly, and return the rows of every part."""
    rows: dict[str, list[Row]] = {}
    for task, own in zip(tasks, spread(Task.rows, tasks, processes=jobs, step="flights", progress=tell), strict=True):
        rows.setdefault(task.part, []).extend(own)
    return {part: pd.DataFrame(own) for part, own in rows.items()}


# ---- figures of merit ----

Cell = Callable[[pd.DataFrame], object]


def share(column: str) -> Cell:
    """Say of what share of the faults a column is true."""
    return lambda rows: share_text(int(rows[column].sum()), len(rows))


def median_s(rows: pd.DataFrame) -> float:
    """Return the median delay; what was missed is infinitely late."""
    return float(np.median(rows["delay_s"]))


def p95_s(rows: pd.DataFrame) -> float:
    """Return the 95th percentile of the delays, one that was measured."""
    return float(np.percentile(rows["delay_s"], 95, method="higher"))


def fast(rows: pd.DataFrame) -> pd.DataFrame:
    """Return all faults but the slowest drift."""
    return rows[(rows["fault"] != "drift") | (rows["severity"] != MILD)]


def ramp_s(rows: pd.DataFrame) -> float:
    """Return the worst delay of the faster drift."""
    return float(rows["delay_s"][(rows["fault"] == "drift") & (rows["severity"] == STRONG)].max())


def figures_of(parts: Mapping[str, pd.DataFrame]) -> dict[str, dict[str, float]]:
    """Return the figures of merit that have targets."""
    return {
        f"filter of {name}": {"detected_isolated": float(faults["isolated"].mean())}
        for name, faults in parts["filters"].groupby("monitor")
    }


TARGETS = (
    Target("filter of 1 s: detected and isolated, at least 95 %", "filter of 1 s", "detected_isolated", ">=", 0.95),
    Target("filter of 5 s: detected and isolated, at least 95 %", "filter of 5 s", "detected_isolated", ">=", 0.95),
)


# ---- the report ----


def report(parts: Mapping[str, pd.DataFrame], figures: Mapping[str, Mapping[str, float]], size: Size) -> str:
    """Return the report as Markdown."""
    fair, poor = IMPERFECT["fair"], IMPERFECT["poor"]
    return f"""# Other sensors, other tests

{SAID_QUICK if size is QUICK else ""}Calibrated on {size.calibration} flights of {size.duration_s:g} s ({CALIBRATION},
T2 noise; every third identifies, the others set the thresholds, for 0.002 false alarms an hour). Judged on flights,
noise seeds and an excitation ({UNSEEN}) that calibration never saw. Delays count look-ahead and windows; intervals are
95 % (Clopper-Pearson), bounds on rates 95 % (Poisson).

## Targets

{markdown(held(TARGETS, figures))}

## Attitude from a filter that the faulty gyros drive (bank C-filtered)

{table(parts["filters"], {"time constant": "monitor"}, OF_FILTERS)}

The reference has 0.5 deg of noise. A gyro's fault bends the attitude as well, within the time constant: what is left of
it in the residual fades, so slow faults come later, and after the first finding no other is trusted.

![Delay against the time constant](filter.png)

## Imperfect but healthy sensors (bank C)

{table(parts["imperfect_healthy"], {"calibrated for": "monitor"}, OF_HEALTHY)}

Smallest faults seen within 60 s, calibrated for the sensors they meet ("fair": {fair}; "poor":
{poor}; deg/s, deg/s per root of a second, deg/s):

{markdown(small_faults(parts["imperfect_faults"]))}

## Test statistics (bank C's residuals, each calibrated for the same false-alarm rate)

{table(parts["tests"], {"test": "monitor"}, OF_TESTS)}
"""


SAID_QUICK = "**Quick: one short flight a part, jams only. It shows that the script runs, and bounds nothing.**\n\n"


def table(rows: pd.DataFrame, by: Mapping[str, str], cells: Mapping[str, Cell]) -> str:
    """Return a line a group as Markdown."""
    return markdown(grouped(rows, by, cells))


def seconds(value: Callable[[pd.DataFrame], float]) -> Cell:
    """Say a time to its hundredth."""
    return lambda rows: f"{value(rows):.2f}"


SLOW_AND_WORST: dict[str, Cell] = {
    "95 % without 0.01 drift (s)": seconds(lambda rows: p95_s(fast(rows))),
    "drift 0.05, worst (s)": seconds(ramp_s),
}
OF_FILTERS: dict[str, Cell] = {
    "detected": share("clean"),
    "detected and isolated": share("isolated"),
    "median delay (s)": seconds(median_s),
    "95 % (s)": seconds(p95_s),
}
OF_HEALTHY: dict[str, Cell] = {
    "false alarms": lambda rows: int(rows["alarms"].sum()),
    "hours": lambda rows: f"{rows['hours'].sum():.2f}",
    "an hour at most": lambda rows: (
        f"{rate_bound(int(rows['alarms'].sum()), float(rows['hours'].sum())) or np.inf:.2g}"
    ),
}
OF_TESTS: dict[str, Cell] = {"detected": share("detected"), "median (s)": seconds(median_s), **SLOW_AND_WORST}


def small_faults(faults: pd.DataFrame) -> pd.DataFrame:
    """Return the share of small faults detected within 60 s."""
    named = faults.assign(in_time=faults["delay_s"] <= 60.0, fault=faults["fault"] + ", " + faults["severity"])
    grid = named.pivot_table(index="fault", columns="monitor", values="in_time", aggfunc="mean", sort=False)
    return (100.0 * grid).map(lambda value: f"{value:.0f} %").reset_index()


def filter_figure(faults: pd.DataFrame) -> Figure:
    """Draw every fault's median delay over the filter's time constant."""
    figure, ((axis,),) = panels(1, 1, (8.0, 4.0))
    for kind, own in faults.groupby("fault", sort=False):
        medians = [median_s(own[own["monitor"] == name]) for name in FILTERS_S]
        axis.plot(list(FILTERS_S.values()), medians, "o-", label=str(kind).replace("_", " "))
    axis.set(xscale="log", yscale="log", xlabel="time constant of the attitude filter (s)", ylabel="median delay (s)")
    axis.legend(fontsize="small")
    return figure


def write(out: Path, parts: Mapping[str, pd.DataFrame], figures: Mapping[str, object]) -> None:
    """Write the report's figures, and every row."""
    filter_figure(parts["filters"]).savefig(out / "filter.png", dpi=130)
    (out / "figures.json").write_text(json.dumps(figures, indent=2) + "\n")
    for name, rows in parts.items():
        rows.to_csv(out / f"{name}.csv", index=False)


def conduct(campaign: Campaign) -> Findings:
    """Fly, judge, report."""
    size = QUICK if campaign.quick else Size()
    parts = flown(tasks(size, calibrated(size, campaign.jobs, campaign.tell)), campaign.jobs, campaign.tell)
    figures = figures_of(parts)
    return Findings(
        report(parts, figures, size), is_missed(TARGETS, figures), partial(write, parts=parts, figures=figures)
    )


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one short flight a part", beside="figures"))
