"""A gyro fails while somebody flies on it: what painting faults into records hides, and what accommodation saves.

    python experiments/in_the_loop.py [--quick] [--out DIR] [--jobs N]

Calibrates banks C and C-early on open-loop GTM flights (multisine and turbulence, the T2's noise). Then

- breaks gyros of flights in turbulence three times: the record of an open-loop flight, the record of a healthy flight
  with the autopilot, and the reading that the autopilot flies on; and asks for delay, residual, and the aircraft;
- identifies the dissertation's operator in one loop and takes it to the other;
- flies random faults of gyros, attitude angles and two gyros one after the other, and healthy flights, with and without
  `gb.Accommodate`, beside a rate set to zero and a switch to a healthy spare at the alarm.

Writes report.md and every row into DIR; prints the tables, and ends with code 1 where a target of `TARGETS` is missed
(never with --quick, whose figures bound nothing).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.detectors.accommodation.without_sensor import REPLACED, SUSPECTED
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress
from gtmbench.report.markup import markdown
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.score import first_after
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped
from studies.targets import Target, held, is_missed

CALIBRATION, FLOWN = "multisine+turbulence", "turbulence"
CALIBRATION_SEED, PLACE_SEED, OPERATOR_SEED, RANDOM_SEED = (
    620_001,
    630_001,
    640_001,
    650_001,
)  # of nobody else's flights
OPEN, CLOSED, LOOP = "open-loop record", "closed-loop record", "in the loop"
NONE, NAMED, PLAIN, ZERO, SPARE = "nothing", "virtual rate (C-early)", "virtual rate (C)", "zero (C-early)", "spare"
_TAKEN_OVER_S = 2.0  # after the onset: from where on rates are compared

FAULTS: dict[str, Callable[[str, float], gb.Fault]] = {
    "sign_flip": lambda channel, onset_s: gb.SignFlip(channel=channel, onset_s=onset_s),
    "hardover 100 deg/s": lambda channel, onset_s: gb.Hardover(channel=channel, onset_s=onset_s, limit=100.0),
    "bias 2 deg/s": lambda channel, onset_s: gb.Bias(channel=channel, onset_s=onset_s, size=2.0),
    "drift 0.5 deg/s²": lambda channel, onset_s: gb.Drift(channel=channel, onset_s=onset_s, slope=0.5),
    "jam": lambda channel, onset_s: gb.Jam(channel=channel, onset_s=onset_s),
    "scale 0.3": lambda channel, onset_s: gb.ScaleFactor(channel=channel, onset_s=onset_s, factor=0.3),
    "deadzone 2 deg/s": lambda channel, onset_s: gb.Deadzone(channel=channel, onset_s=onset_s, half_width=2.0),
    "lag 0.2 s": lambda channel, onset_s: gb.Lag(channel=channel, onset_s=onset_s, lag_s=0.2),
}

Row = dict[str, object]
Monitors = Mapping[str, BankMonitor]


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much is flown, in flights and seconds."""

    calibration: int = 12
    calibration_s: float = 300.0
    onset_s: float = 40.0
    duration_s: float = 80.0
    flights: int = 2  # of every fault
    kinds: Sequence[str] = tuple(FAULTS)
    gyros: Sequence[str] = GYROS
    operator: int = 3
    operator_s: float = 200.0
    random_onset_s: float = 15.0
    random_s: float = 40.0
    random: int = 200
    angles: int = 40
    pairs: int = 30
    apart_s: float = 10.0
    healthy: int = 6
    healthy_s: float = 200.0


QUICK = Size(
    calibration=2,
    calibration_s=120.0,
    onset_s=15.0,
    duration_s=20.0,
    flights=1,
    kinds=("jam",),
    gyros=("q",),
    operator=1,
    operator_s=60.0,
    random_s=18.0,
    random=1,
    angles=1,
    pairs=1,
    apart_s=2.0,
    healthy=1,
    healthy_s=20.0,
)


def calibrated(size: Size, jobs: int, tell: Progress) -> Monitors:
    """Calibrate both banks in open loop."""
    flights = CalibrationFlights(
        flights=size.calibration, duration_s=size.calibration_s, excitation=CALIBRATION, seed=CALIBRATION_SEED
    )
    records = flights.sensed(SENSORS, processes=jobs, progress=tell)
    return {
        bank: gb.calibrate(records, bank=gb.load_bank(bank), estimator=gb.LeastSquares()) for bank in ("C", "C-early")
    }


# ---- where a fault is put ----


@dataclass(frozen=True, kw_only=True)
class Place:
    """A flight whose gyros break in turn, in its record and in its loop."""

    seed: int
    size: Size
    monitor: BankMonitor

    def rows(self) -> list[Row]:
        """Fly, and return a row a fault and place."""
        size, seed = self.size, self.seed
        flight = gb.fly("gtm", FLOWN, size.duration_s, seed)
        healthy = {OPEN: gb.measure(flight, noise="t2", seed=seed), CLOSED: self._flown(()).sensed}
        rows = []
        for kind in size.kinds:
            for channel in size.gyros:
                fault = FAULTS[kind](channel, size.onset_s)
                what = {"seed": seed, "fault": kind, "channel": channel}
                rows += [what | self._row(place, gb.inject(of, fault), fault) for place, of in healthy.items()]
                flown = self._flown((fault,))
                rows.append(what | self._row(LOOP, flown.sensed, fault) | became(flown, size.onset_s))
        return rows

    def _flown(self, faults: Sequence[gb.Fault]) -> gb.LoopFlight:
        return gb.fly_in_loop("gtm", FLOWN, self.size.duration_s, self.seed, faults=faults, sensors="ideal")

    def _row(self, place: str, broken: gb.Record, fault: gb.Fault) -> Row:
        watch = self.monitor.watch(broken)
        alarm = first_after(watch.alarms, fault.onset_s)
        rest = watch.residuals[fault.channel][(broken.time_s >= fault.onset_s) & (broken.time_s < fault.onset_s + 1.0)]
        known = rest[np.isfinite(rest)]
        return {
            "place": place,
            "delay_s": np.inf if alarm is None else alarm.time_s - fault.onset_s,
            "residual": float(np.sqrt(np.mean(known**2))) if len(known) else np.nan,
        }


def became(flown: gb.LoopFlight, onset_s: float) -> Row:
    """Return what became of the aircraft: when it departed, rates once all is decided, altitude lost, the bank."""
    truth = flown.truth
    after, later = truth.time_s >= onset_s, truth.time_s >= onset_s + _TAKEN_OVER_S
    rates = {f"rms_{name}": float(np.std(truth[name][later])) if later.any() else np.inf for name in GYROS}
    return {
        "departed_s": np.inf if flown.departed_s is None else flown.departed_s - onset_s,
        "sunk_ft": float(truth["altitude"][0] - truth["altitude"][after].min()),
        "bank_deg": float(np.abs(truth["phi"][after]).max()),
        **rates,
    }


# ---- the dissertation's operator ----


def operator_rows(seed: int, duration_s: float) -> list[Row]:
    """Identify from p, q and beta to r in each loop; return what is left of it in both, on other flights."""

    def flights(number: int) -> dict[str, gb.Record]:
        own = seed + 100 * number
        closed = gb.fly_in_loop("gtm", FLOWN, duration_s, own, sensors="ideal").sensed
        return {"open loop": gb.measure(gb.fly("gtm", FLOWN, duration_s, own), noise="t2", seed=own), "closed": closed}

    known, other = flights(0), flights(1)
    rows = []
    for identified, of in known.items():
        operator = gb.identify(of, inputs=["p", "q", "beta"], outputs=["r"], causal_order=50, noncausal_order=50)
        for watched, record in other.items():
            left = gb.residual(operator, record).values  # noqa: PD011
            rms = float(np.sqrt(np.nanmean(left**2)))
            rows.append(
                {"identified": identified, "watched": watched, "residual": rms, "r": float(np.std(record["r"]))}
            )
    return rows


# ---- accommodation ----


def drawn_fault(random: np.random.Generator, channel: str, onset_s: float) -> gb.Fault:
    """Draw a kind of fault and its severity: of a gyro in deg/s, of an angle in deg and a fifth of that."""
    share, sign = (1.0 if channel in GYROS else 0.2), float(random.choice([-1.0, 1.0]))

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    def size(low: float, high: float) -> float:
        return share * between(low, high)

    makers: list[Callable[..., gb.Fault]] = [
        gb.SignFlip,
        gb.Jam,
        gb.Dropout,
        partial(gb.Hardover, limit=sign * size(20.0, 150.0)),
        partial(gb.Bias, size=sign * size(1.0, 30.0)),
        partial(gb.Drift, slope=sign * size(0.1, 5.0)),
        partial(gb.ScaleFactor, factor=sign * between(0.3, 4.0)),
        partial(gb.Noise, deviation=size(2.0, 20.0), seed=int(random.integers(1000))),
        partial(gb.Oscillation, amplitude=size(2.0, 30.0), frequency_hz=between(0.2, 3.0)),
        partial(gb.Spikes, size=size(10.0, 100.0), rate_hz=between(1.0, 10.0), seed=int(random.integers(1000))),
        partial(gb.Delay, delay_s=between(0.05, 0.3)),
        partial(gb.Lag, lag_s=between(0.05, 0.5)),
        partial(gb.Deadzone, half_width=size(1.0, 10.0)),
        partial(gb.Saturation, limit=size(0.5, 5.0)),
        partial(gb.RateSaturation, rate_limit=size(1.0, 20.0)),
        partial(gb.Quantisation, quantum=size(1.0, 10.0)),
    ]
    return makers[int(random.integers(len(makers)))](channel=channel, onset_s=onset_s)


@dataclass(frozen=True, kw_only=True)
class Rescue:
    """One flight in turbulence, healthy or with faults drawn by its seed, with and without accommodation."""

    part: str
    seed: int
    size: Size
    monitors: Monitors

    def rows(self) -> list[Row]:
        """Fly, and return a row a remedy."""
        faults = tuple(self._faults())
        onset_s = faults[0].onset_s if faults else 0.0
        duration_s = self.size.random_s if faults else self.size.healthy_s
        fly = partial(gb.fly_in_loop, "gtm", FLOWN, duration_s, self.seed, sensors="ideal")
        early, plain = gb.Accommodate(self.monitors["C-early"]), gb.Accommodate(self.monitors["C"])
        flown = {NONE: fly(faults=faults), NAMED: fly(faults=faults, accommodate=early)}
        if self.part == "healthy":
            flown[PLAIN] = fly(faults=faults, accommodate=plain)
        if self.part == "gyros":
            flown[ZERO] = fly(faults=faults, accommodate=replace(early, stand_in="zero"))
            flown[SPARE] = fly(faults=tuple(self._until_suspected(faults, flown[NAMED])))
        what = {
            "part": self.part,
            "seed": self.seed,
            "fault": "; ".join(f"{fault.kind} of {fault.channel}" for fault in faults),
        }
        broken = {fault.channel for fault in faults}
        return [
            what | {"remedy": name} | became(of, onset_s) | acted(of, broken, onset_s) for name, of in flown.items()
        ]

    def _faults(self) -> Iterator[gb.Fault]:
        random, onset_s = np.random.default_rng(self.seed), self.size.random_onset_s
        if self.part == "gyros":
            yield drawn_fault(random, str(random.choice(GYROS)), onset_s)
        elif self.part == "angles":
            yield drawn_fault(random, str(random.choice(ATTITUDE)), onset_s)
        elif self.part == "pairs":
            first, second = random.permutation(GYROS)[:2]
            yield drawn_fault(random, str(first), onset_s)
            yield drawn_fault(random, str(second), onset_s + float(random.uniform(0.0, self.size.apart_s)))

    def _until_suspected(self, faults: Sequence[gb.Fault], flown: gb.LoopFlight) -> Iterator[gb.Fault]:
        """Give the faults as a switch to a spare at the alarm lets them last."""
        for fault in faults:
            told = [
                event.time_s
                for event in flown.events
                if event.channel == fault.channel and event.kind in (SUSPECTED, REPLACED)
            ]
            yield replace(fault, duration_s=max(told[0] - fault.onset_s, 0.01)) if told else fault


def acted(flown: gb.LoopFlight, broken: set[str], onset_s: float) -> Row:
    """Return what an accommodation did: when it first distrusted and replaced, and whom it replaced wrongly."""

    def after_s(kind: str) -> float:
        return min((event.time_s - onset_s for event in flown.events if event.kind == kind), default=np.inf)

    wrong = {event.channel for event in flown.events if event.kind == REPLACED} - broken
    return {"suspected_s": after_s(SUSPECTED), "replaced_s": after_s(REPLACED), "wrong": len(wrong)}


def rescues(size: Size, monitors: Monitors) -> list[Rescue]:
    """Return every flight of the second half."""
    parts = {"gyros": size.random, "angles": size.angles, "pairs": size.pairs, "healthy": size.healthy}
    return [
        Rescue(part=part, seed=RANDOM_SEED + 1000 * i + number, size=size, monitors=monitors)
        for i, (part, count) in enumerate(parts.items())
        for number in range(count)
    ]


# ---- report ----


def median(column: str, digits: int = 2) -> Callable[[pd.DataFrame], str]:
    """Say the median of a column; what was missed is infinitely late."""
    return lambda rows: f"{np.percentile(rows[column], 50, method='higher'):.{digits}f}"


def most(column: str) -> Callable[[pd.DataFrame], str]:
    """Say the greatest of a column."""
    return lambda rows: f"{rows[column].max():.0f}"


def departed(rows: pd.DataFrame) -> int:
    """Count the flights that departed."""
    return int(np.isfinite(rows["departed_s"]).sum())


def first_departure(rows: pd.DataFrame) -> str:
    """Say when the first of them departed."""
    return f"{rows['departed_s'].min():.2f}" if departed(rows) else "-"


def places_table(rows: pd.DataFrame) -> str:
    """Return a line a fault and gyro: delays and residuals by place, and what became of the aircraft."""
    cells: dict[str, Callable[[pd.DataFrame], object]] = {}
    for name, column in (("delay, s", "delay_s"), ("residual, deg/s", "residual")):
        for place in (OPEN, CLOSED, LOOP):
            cells[f"{name}: {place}"] = partial(of_place, place, median(column))
    cells["departed"] = partial(
        of_place, LOOP, lambda own: f"{departed(own)} of {len(own)}" if departed(own) else "none"
    )
    cells["first after (s)"] = partial(of_place, LOOP, first_departure)
    cells["greatest bank (deg)"] = partial(of_place, LOOP, median("bank_deg", 0))
    cells["sunk (ft)"] = partial(of_place, LOOP, median("sunk_ft", 0))
    return markdown(grouped(rows, {"fault": "fault", "gyro": "channel"}, cells))


def of_place(place: str, cell: Callable[[pd.DataFrame], object], rows: pd.DataFrame) -> object:
    """Say something of the rows of one place."""
    return cell(rows[rows["place"] == place])


def rescue_table(rows: pd.DataFrame) -> str:
    """Return a line a remedy."""
    cells: dict[str, Callable[[pd.DataFrame], object]] = {
        "flights": len,
        "departed": departed,
        **{f"RMS {name} (deg/s)": median(f"rms_{name}") for name in GYROS},
        "sunk, median (ft)": median("sunk_ft", 0),
        "sunk, most (ft)": most("sunk_ft"),
        "suspected (s)": median("suspected_s"),
        "named (s)": median("replaced_s"),
        "healthy gyro replaced": lambda own: int((own["wrong"] > 0).sum()),
    }
    return markdown(grouped(rows, {"remedy": "remedy"}, cells))


def changed(rows: pd.DataFrame) -> str:
    """Return the flights that departed without accommodation or with it, and when."""
    wide = rows.pivot_table(index=["seed", "fault"], columns="remedy", values="departed_s", sort=False)
    lost = wide[np.isfinite(wide[[NONE, NAMED]]).any(axis=1)].reset_index()
    lines = [
        {"fault": row["fault"], **{f"{name}, departed after (s)": f"{row[name]:.2f}" for name in (NONE, NAMED)}}
        for _, row in lost.iterrows()
    ]
    return markdown(pd.DataFrame(lines)) if lines else "None departed."


def figures_of(rows: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return, by part, how many flights depart with accommodation that don't without, and how many fewer do in all."""
    figures = {}
    for part, own in rows.groupby("part", sort=False):
        by_seed = {name: of.set_index("seed")["departed_s"] for name, of in own.groupby("remedy")}
        lost, kept = np.isfinite(by_seed[NAMED]), ~np.isfinite(by_seed[NONE])
        figures[str(part)] = {"made": int((lost & kept).sum()), "left": int(lost.sum())}
    return figures


TARGETS = (
    Target("gyros: no flight departs that wouldn't without accommodation", "gyros", "made", "<=", 0),
    Target("attitude angles: no flight departs that wouldn't without", "angles", "made", "<=", 0),
    Target("two gyros: no flight departs that wouldn't without", "pairs", "made", "<=", 0),
    Target("healthy: no flight departs", "healthy", "left", "<=", 0),
)
SAID_QUICK = "**Quick: one short flight of each. It shows that the script runs, and bounds nothing.**\n\n"


def report(places: pd.DataFrame, operator: pd.DataFrame, rescued: pd.DataFrame, size: Size) -> str:
    """Return the report as Markdown."""
    left = {"identified in": "identified", "watched in": "watched"}
    residuals = grouped(operator, left, {"residual of r (deg/s)": median("residual"), "RMS r (deg/s)": median("r")})
    parts = {str(part): own for part, own in rescued.groupby("part", sort=False)}
    return f"""# In the loop

{SAID_QUICK if size is QUICK else ""}Banks C and C-early, calibrated on {size.calibration} open-loop flights of
{size.calibration_s:g} s ({CALIBRATION}, T2 noise). Everything below is flown in {FLOWN}, on seeds of its own.

## Targets

{markdown(held(TARGETS, figures_of(rescued)))}

## Where a fault is put

The same fault of a gyro in the record of an open-loop flight, in that of a healthy flight with the autopilot, and in
the reading that the autopilot flies on; {size.flights} flights of {size.duration_s:g} s, onset at {size.onset_s:g} s.
Medians, of bank C; the residual is the RMS of the gyro's own over the first second.

{places_table(places)}

## An operator is tied to its loop

From p, q and beta to r, 50 lags either way, identified on one flight and watched on another, {size.operator} times.

{markdown(residuals)}

## Accommodation

Random kinds and severities, onset at {size.random_onset_s:g} s of {size.random_s:g}. Rates are medians of the RMS from
{_TAKEN_OVER_S:g} s after the onset on; times are medians after the onset, inf where half of them have none. *Spare*:
the fault ends at C-early's alarm.

### A gyro fails

{rescue_table(parts["gyros"])}

### An attitude angle fails

{rescue_table(parts["angles"])}

{changed(parts["angles"])}

### Two gyros fail, up to {size.apart_s:g} s apart

{rescue_table(parts["pairs"])}

{changed(parts["pairs"])}

### Nothing fails

{size.healthy} flights of {size.healthy_s:g} s.

{rescue_table(parts["healthy"])}
"""


def conduct(campaign: Campaign) -> Findings:
    """Fly, break, accommodate, report."""
    size, jobs, tell = (QUICK if campaign.quick else Size()), campaign.jobs, campaign.tell
    monitors = calibrated(size, jobs, tell)
    flights = [Place(seed=PLACE_SEED + i, size=size, monitor=monitors["C"]) for i in range(size.flights)]
    placed = spread(Place.rows, flights, processes=jobs, step="faults in records and loops", progress=tell)
    own = partial(operator_rows, duration_s=size.operator_s)
    seeds = range(OPERATOR_SEED, OPERATOR_SEED + size.operator)
    operators = spread(own, seeds, processes=jobs, step="operators", progress=tell)
    planned = rescues(size, monitors)
    rescued = spread(Rescue.rows, planned, processes=jobs, step="accommodation", progress=tell)
    tables = [pd.DataFrame([row for rows in of for row in rows]) for of in (placed, operators, rescued)]

    def write(out: Path) -> None:
        for name, table in zip(("places", "operators", "rescues"), tables, strict=True):
            table.to_csv(out / f"{name}.csv", index=False)

    places, operator, rescued_rows = tables
    missed = is_missed(TARGETS, figures_of(rescued_rows))
    return Findings(report(places, operator, rescued_rows, size), missed, write)


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one short flight of each"))
