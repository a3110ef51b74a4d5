"""Names that can be believed: whether stated probabilities come true, and stated intervals hold the truth.

    python experiments/believed_names.py [--quick] [--first-seed N] [--flights N] [--fit] [--out DIR] [--jobs N]

Bank C, on flights of three excitations with turbulence and one without: every kind of the catalogue on a sensor drawn
anew, with a size drawn between mild and strong and an onset between two samples; three strange faults that no
hypothesis was made for; and one trial of several sensors hit at once. Each judgement is held against the truth: are the
sensors that it names or suspects those that failed, is the kind right, do the intervals of 95 % hold size and onset?
--fit prints the odds of `gtmbench/detectors/isolation/probability.py` as these flights give them; the report's flights
are others. Ends with code 1 where a target is missed (never with --quick).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd

import gtmbench as gb
import several_at_once
import strange_faults
from every_fault import KINDS, MILD, QUICK, STRONG, Size, calibrated, fault_of
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.isolation import probability
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.monitor import open_fault_review
from gtmbench.detectors.protocol import Watch
from gtmbench.faults.registry import how_of
from gtmbench.faults.shape import CONSTANT
from gtmbench.jobs.processes import spread
from gtmbench.report.markup import markdown
from gtmbench.study.score import Truth
from gtmbench.study.scores.intervals import exact_interval
from gtmbench.values.channels import ATTITUDE, GYROS
from studies.conduct import DETAILS, Campaign, Findings, conducted
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

EXCITATIONS = ("doublets+turbulence", "dissertation+turbulence", "multisine+turbulence", "multisine")
FIRST_SEED, FIT_SEED = 760_001, 725_001  # of the report; of the fit; 720,001 to 730,000 were looked at while building
FLIGHTS, QUICK_FLIGHTS = 200, 1
DURATION_S, ONSET_S, WATCHED_FROM_S = 130.0, (70.0, 80.0), 10.0
STRANGE_A_FLIGHT = 3
STRANGE, SEVERAL = "strange", "several"
STEPS = ("bias", "scale_factor", "sign_flip", "jam", "stuck", "hardover", "swap")  # that are there at once
ENDING, LASTS_S = ("bias", "scale_factor", "stuck", "saturation", "noise"), (5.0, 14.0)
LEAST_OF_A_KIND = 20  # intervals: fewer say nothing
RIGHT, WRONG, EITHER_OR, DOUBTED, MISSED = "right", "wrong", "either-or", "can't tell", "missed"
SURE = 0.99
PRIOR = 3.0
READ = 1e-4  # of a figure: a narrower interval is read off the readings, and always holds
Row = dict[str, Any]


def drawn(name: str, channel: str, draw: np.random.Generator) -> float:
    """Draw the figure of a kind of fault, between mild and strong, of either sign where it has one."""
    figures = KINDS[name].gyro if channel in GYROS else KINDS[name].angle
    if name == "stuck":
        return float(draw.uniform(-6.0, 6.0))
    if name == "hardover":
        return float(draw.uniform(40.0, 150.0) * draw.choice([-1.0, 1.0]))
    if len(figures) == 1:
        return figures[0]
    figure = float(np.exp(draw.uniform(*np.log(sorted(figures)))))
    if name == "scale_factor":
        return figure ** float(draw.choice([-1.0, 1.0]))
    return figure * float(draw.choice([-1.0, 1.0]) if name in ("bias", "drift", "g_sensitivity") else 1.0)


@contextmanager
def evidence_kept() -> Iterator[dict[tuple[float, tuple[str, ...]], Row]]:
    """Keep what probabilities were made of, by the judgement's time and candidates."""
    kept: dict[tuple[float, tuple[str, ...]], Row] = {}
    weighed = open_fault_review.with_probability

    def keeping(case: Case, ranking: Sequence[Any], judged: Judgement) -> Judgement:
        evidence = probability.JudgementEvidence.of(case, ranking, judged)
        kept[judged.time_s, judged.candidates] = evidence._asdict()
        return weighed(case, ranking, judged)

    with patch.object(open_fault_review, "with_probability", keeping):
        yield kept


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A flight of the study, on which everything breaks in turn."""

    seed: int
    monitor: BankMonitor

    def rows(self) -> list[Row]:
        """Fly, break and watch; return a row a judgement and a row a parameter that was measured."""
        draw = np.random.default_rng(self.seed)
        flight = gb.fly("gtm", EXCITATIONS[self.seed % len(EXCITATIONS)], DURATION_S, self.seed)
        healthy = gb.measure(flight, noise="t2", seed=self.seed)
        rows: list[Row] = []
        for name in (kind for kind in KINDS if KINDS[kind].family):
            channel, onset_s = str(draw.choice((*GYROS, *ATTITUDE))), float(draw.uniform(*ONSET_S))
            figure, seed = drawn(name, channel, draw), int(draw.integers(1 << 30))
            fault = fault_of(name, channel, figure, flight, (onset_s, DURATION_S), seed=seed)
            rows += self._said(KINDS[name].family, name, gb.inject(healthy, fault), (fault,))
        for _ in range(STRANGE_A_FLIGHT):
            channel, onset_s = str(draw.choice((*GYROS, *ATTITUDE))), float(draw.uniform(*ONSET_S))
            severity = str(draw.choice([MILD, STRONG]))
            every = list(strange_faults.faults(channel, severity, onset_s))
            name, faults = every[int(draw.integers(len(every)))]
            broken = healthy
            for fault in faults:
                broken = gb.inject(broken, fault)
            rows += self._said(STRANGE, name, broken, faults)
        return rows + self._healed(healthy, flight, draw) + self._several(draw)

    def _healed(self, healthy: gb.Record, flight: gb.Record, draw: np.random.Generator) -> list[Row]:
        """Return when faults of gyros ended, by the monitor and in truth."""
        rows: list[Row] = []
        for name in ENDING:
            channel, onset_s = str(draw.choice(GYROS)), float(draw.uniform(*ONSET_S))
            fault = fault_of(name, channel, drawn(name, channel, draw), flight, (onset_s, DURATION_S), seed=self.seed)
            fault = replace(fault, duration_s=float(draw.uniform(*LASTS_S)))
            watch = self.monitor.watch(gb.inject(healthy, fault).between(WATCHED_FROM_S, DURATION_S))
            alarms = [alarm for alarm in watch.faults if alarm.time_s >= onset_s and alarm.sensor == channel]
            end_s = onset_s + (fault.duration_s or 0.0)
            about = {"seed": self.seed, "family": "ended", "fault": name, "channel": channel}
            rows += [about | end_row(alarm, end_s) for alarm in alarms[:1]]
        return rows

    def _several(self, draw: np.random.Generator) -> list[Row]:
        """Return what is said of several sensors that are hit at once, as ``several_at_once.py`` draws them."""
        groups = [several_at_once.CAUSE, several_at_once.TWO, several_at_once.WITH_ANGLE]
        names: list[tuple[str, str]] = [(groups[0], name) for name in several_at_once.CAUSES]
        names += [(groups[1], f"{apart_s:g} s apart") for apart_s in several_at_once.APART_S] * 2
        names += [(groups[2], groups[2])] * 5
        group, name = names[int(draw.integers(len(names)))]
        trial = several_at_once.Trial(group, name, self.seed)
        broken, hit, _, _ = several_at_once.broken_by(trial, several_at_once.flown(trial), draw)
        first_s = several_at_once.ONSET_S
        with evidence_kept() as kept:
            watch = self.monitor.watch(broken.between(several_at_once.WATCHED_FROM_S, broken.end_s))
        about = {"seed": self.seed, "family": SEVERAL, "fault": name, "channel": " ".join(sorted(hit))}
        alarms = [alarm for alarm in watch.faults if alarm.time_s > first_s]
        return [
            about | judged_row(judged, kept, judged is alarm.last, set(hit)) | {"since_s": judged.time_s - alarm.time_s}
            for alarm in alarms
            for judged in alarm.judgements
            if judged.probability is not None
        ]

    def _said(self, family: str, name: str, broken: gb.Record, faults: tuple[gb.Fault, ...]) -> list[Row]:
        """Return what is said of faults of one sensor."""
        watched = broken.between(WATCHED_FROM_S, DURATION_S)
        with evidence_kept() as kept:
            watch = self.monitor.watch(watched)
        truth = Truth(faults=faults, broken=watched)
        about = {"seed": self.seed, "family": family, "fault": name, "channel": faults[0].channel}
        return [about | row for row in of_watch(watch, kept, truth)]


def of_watch(watch: Watch, kept: Mapping[tuple[float, tuple[str, ...]], Row], truth: Truth) -> Iterator[Row]:
    """Give a row a judgement of the first fault that a monitor tells, and a row a parameter of its last one."""
    alarms = [alarm for alarm in watch.faults if alarm.time_s >= truth.onset_s]
    if not alarms:
        yield {"part": "fault", "outcome": MISSED}
        return
    alarm = alarms[0]
    yield {"part": "fault", "outcome": outcome_of(alarm, truth)}
    for judged in alarm.judgements:
        if judged.probability is not None:
            kind = truth.judged_right(judged, judged.time_s)
            about = {"since_s": judged.time_s - alarm.time_s, "kind right": kind is not None, "said": judged.kind}
            yield judged_row(judged, kept, judged is alarm.last, set(truth.channels)) | about
    yield from measured(alarm, truth)


def outcome_of(alarm: Alarm, truth: Truth) -> str:
    """Return what came of a fault of one sensor, by the last judgement of its first alarm."""
    if alarm.has_passed:
        return MISSED
    if alarm.doubt:
        return DOUBTED
    if alarm.last is None or not alarm.last.failed:
        return EITHER_OR
    return RIGHT if set(alarm.last.failed) <= truth.channels else WRONG


def end_row(alarm: Alarm, end_s: float) -> Row:
    """Hold the end of a fault against the truth."""
    low, high = alarm.ended_between_s or (np.nan, np.nan)
    found = np.nan if alarm.ended_s is None else alarm.ended_s
    holds = bool(low - 1e-9 <= end_s <= high + 1e-9)
    return {"part": "ended", "value": found, "low": low, "high": high, "off": abs(found - end_s), "holds": holds}


def judged_row(
    judged: Judgement, kept: Mapping[tuple[float, tuple[str, ...]], Row], is_last: bool, hit: set[str]
) -> Row:
    """Hold the sensors of a judgement against those that are hit: all that it names, or one of those suspected."""
    named = set(judged.failed)
    return {
        "part": "judged",
        "named": bool(named),
        "right": bool(named <= hit if named else hit & set(judged.candidates)),
        "wrong": bool(named - hit),
        "last": is_last,
        "probability": judged.probability,
        "kind probability": judged.kind_probability,
    } | dict(kept.get((judged.time_s, judged.candidates), {}))


def measured(alarm: Alarm, truth: Truth) -> Iterator[Row]:
    """Give a row a parameter of an alarm's last judgement, where its kind is right."""
    judged = alarm.last
    fault = None if judged is None or judged.sensor is None else truth.judged_right(judged, judged.time_s)
    if judged is None or judged.sensor not in truth.channels:
        return
    true = truth.parameters(fault) if fault is not None else {"onset_s": truth.onset_s}
    for name, (low, high) in judged.intervals.items():
        if name in true and name in judged.parameters:
            value = judged.parameters[name]
            yield {
                "part": "measured",
                "parameter": name,
                "value": value,
                "low": low,
                "high": high,
                "true": true[name],
                "off": abs(value - true[name]),
                "holds": bool(low - 1e-9 <= true[name] <= high + 1e-9),
                "as test": abs(alarm.onset_s - true[name]) if name == "onset_s" else np.nan,
                "said": judged.kind,
            }


# ---- the fit ----


def fitted(rows: pd.DataFrame) -> str:
    """Return the odds that make what came out most likely, as lines of code."""
    judged = rows[rows["part"] == "judged"]
    is_known = ~judged["family"].isin([STRANGE, SEVERAL])  # faults of which one kind is right
    kinds = judged[is_known & judged["kind probability"].notna() & judged["right"].astype(bool)]
    together = judged["together"].astype(bool)
    held_ = kinds["said"].map(how_of).isin(CONSTANT)
    parts = {
        "NAMED": (judged[judged["named"].astype(bool) & ~together], "right", "margin"),
        "SUSPECTED": (judged[~judged["named"].astype(bool)], "right", "margin"),
        "TOGETHER": (judged[together], "right", "margin"),
        "KIND": (kinds[~held_], "kind right", "kind_margin"),
        "KIND_HELD": (kinds[held_], "kind right", "kind_margin"),
    }
    return "\n".join(
        f"{name} = {odds_of(of, right, margin)}  # of {len(of)}" for name, (of, right, margin) in parts.items()
    )


def odds_of(rows: pd.DataFrame, right: str, margin: str) -> probability.Odds:
    """Return the likeliest odds, growing with time and margin, where each figure is within some `PRIOR` of 0."""
    from scipy.optimize import minimize

    seconds = rows["judged_s"].to_numpy(dtype=float)
    margins = rows[margin].to_numpy(dtype=float)
    came_true = rows[right].to_numpy(dtype=bool)

    def surprise(figures: np.ndarray) -> float:
        stated = probability.Odds(*figures).probabilities(seconds, margins)
        each = np.log(np.where(came_true, stated, 1.0 - stated))
        return float(0.5 * np.sum(np.square(figures / PRIOR)) - each.sum())

    found = minimize(
        surprise, np.array([2.0, 0.5, 0.2]), method="L-BFGS-B", bounds=[(None, None), (0.0, None), (0.0, None)]
    )
    return probability.Odds(*(round(float(each), 2) for each in found.x))


# ---- the report ----

BINS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)


def reliability(rows: pd.DataFrame, stated: str, right: str) -> pd.DataFrame:
    """Return how often what was stated came true, by what was stated."""
    known = rows[rows[stated].notna()]
    lines = []
    for low, high in pairwise(BINS):
        own = known[(known[stated] > low) & (known[stated] <= high)]
        if len(own):
            lines.append(
                {
                    "stated": f"{low:g} to {high:g}",
                    "mean stated": f"{own[stated].mean():.3f}",
                    "came true": share_text(int(own[right].sum()), len(own)),
                }
            )
    return pd.DataFrame(lines)


def merits(rows: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return what the targets ask for."""
    judged, of = rows[rows["part"] == "judged"], rows[rows["part"] == "measured"]
    sure = judged[judged["probability"] >= SURE]
    families = sure.groupby("family")["right"].agg(["size", "sum"])
    upper = [exact_interval(int(each["sum"]), int(each["size"]))[1] for _, each in families.iterrows()]
    of = of[of["fault"].isin(KINDS)]
    onsets, sizes = of[of["parameter"] == "onset_s"], of[of["parameter"] != "onset_s"]
    ended = rows[(rows["part"] == "ended") & rows["low"].notna()]
    kinds = of.groupby(["fault", "parameter"])["holds"].agg(["size", "mean"])
    enough = kinds[kinds["size"] >= LEAST_OF_A_KIND]
    is_last = judged["last"].astype(bool) & judged["fault"].isin(KINDS) & judged["right"].astype(bool)
    last = judged[is_last & judged["kind probability"].notna()]
    return {
        "sensor": {
            "least": float((families["sum"] / families["size"]).min()),
            "upper": float(min(upper)),
            "wrong": float(judged[judged["last"].astype(bool)]["wrong"].mean()),
        },
        "kind": {"gap": float(abs(last["kind probability"].mean() - last["kind right"].mean()))},
        "interval": {
            "sizes": float(sizes[sizes["high"] - sizes["low"] > READ * sizes["true"].abs()]["holds"].mean()),
            "onsets": float(onsets["holds"].mean()),
            "ends": float(ended["holds"].mean()),
            "worst": float(enough["mean"].min()) if len(enough) else np.nan,
        },
        "onset": {"steps": float(onsets[onsets["fault"].isin(STEPS)]["off"].median())},
    }


TARGETS = (
    Target("a stated 99 % is right in 98 % and more, in each family", "sensor", "least", ">=", 0.98),
    Target("the sensor that is named last is wrong in at most 0.5 %", "sensor", "wrong", "<=", 0.005),
    Target("probabilities of kinds, on average of last judgements, are off by at most 0.02", "kind", "gap", "<=", 0.02),
    Target("intervals of sizes that are estimated hold the truth in at least 92 %", "interval", "sizes", ">=", 0.92),
    Target("intervals of sizes that are estimated hold the truth in at most 98 %", "interval", "sizes", "<=", 0.98),
    Target("intervals of onsets hold the truth in at least 92 %", "interval", "onsets", ">=", 0.92),
    Target("intervals of onsets hold the truth in at most 98 %", "interval", "onsets", "<=", 0.98),
    Target("intervals of ends hold the truth in at least 92 %", "interval", "ends", ">=", 0.92),
    Target("intervals of each kind hold the truth in at least 85 %", "interval", "worst", ">=", 0.85),
    Target("the onset of steps is off by at most 0.1 s in the median", "onset", "steps", "<=", 0.1),
)


def share(column: str) -> Any:
    """Say how often a column is true."""
    return lambda rows: share_text(int(rows[column].sum()), len(rows))


def report(rows: pd.DataFrame, figures: Mapping[str, Mapping[str, float]], size: Size, *, quick: bool) -> str:
    """Return the report as Markdown."""
    judged, of = rows[rows["part"] == "judged"], rows[rows["part"] == "measured"]
    sure, last = judged[judged["probability"] >= SURE], judged[judged["last"].astype(bool)]
    right = judged[judged["kind probability"].notna() & judged["right"].astype(bool)]
    of_catalogue = right[~right["family"].isin([STRANGE, SEVERAL])]
    onsets, sizes = of[of["parameter"] == "onset_s"], of[of["parameter"] != "onset_s"]
    ended, faults = rows[rows["part"] == "ended"], rows[rows["part"] == "fault"]
    wrong = [
        f"- {row['fault']} of {row['channel']}, {row['seed']}, {row['since_s']:.2f} s after the alarm: "
        f"stated {row['probability']:.3f}"
        for row in judged[judged["wrong"]].to_dict("records")
    ]
    return f"""# Names that can be believed

{several_at_once.SAID_QUICK if quick else ""}Bank C, calibrated on {size.calibration} flights of
{size.calibration_s:g} s, watches {rows["seed"].nunique()} flights (seeds {rows["seed"].min()} to {rows["seed"].max()};
{", ".join(EXCITATIONS)} in turn). On each,
every kind breaks a sensor, by a size and an onset that are drawn; then three strange faults, and several sensors at
once. Every judgement counts, from the first look at 0.75 s on. The odds were fitted on seeds from {FIT_SEED} on.

## Targets

{markdown(held(TARGETS, figures))}

## What comes of a fault

{markdown(grouped(faults, {"family": "family"}, FAULT_CELLS))}

All: {outcomes_text(faults)}.

## Sensors that are stated with 99 % and more

Right is a name of sensors that all failed, or a choice between sensors of which one did.

{markdown(grouped(sure, {"family": "family"}, {"judgements": len, "right": share("right")}))}

The last judgement of each fault:

{markdown(grouped(last, {"family": "family"}, LAST_CELLS))}

## Reliability of the sensor's probability

{markdown(reliability(judged, "probability", "right"))}

## Reliability of the kind's probability

Of the catalogue, where the sensor is right. A kind counts as right that has read the same so far.

{markdown(reliability(of_catalogue, "kind probability", "kind right"))}

![What was stated, and how often it came true](reliability.png)

## A healthy sensor named, at any time

{chr(10).join(wrong) or "None."}

{DETAILS}

## Intervals of 95 %

{markdown(grouped(sizes, {"fault": "fault", "parameter": "parameter"}, SIZE_CELLS))}

## Onsets

Of strange faults the kind that is told isn't theirs, and so neither is its onset.
*Test's*: how far off the alarm's own test dates the onset, in the median.

{markdown(grouped(onsets, {"fault": "fault"}, ONSET_CELLS))}

## Ends

Faults of gyros that last {LASTS_S[0]:g} to {LASTS_S[1]:g} s, where the gyro is named.

{markdown(grouped(ended, {"fault": "fault"}, END_CELLS))}
"""


FAULT_CELLS: Mapping[str, Any] = {"faults": len} | {
    name: lambda rows, name=name: f"{100.0 * (rows['outcome'] == name).mean():.1f} %"
    for name in (RIGHT, WRONG, EITHER_OR, DOUBTED, MISSED)
}


def outcomes_text(rows: pd.DataFrame) -> str:
    """Say what came of all faults."""
    return ", ".join(f"{name} {each(rows)}" for name, each in list(FAULT_CELLS.items())[1:])


LAST_CELLS: Mapping[str, Any] = {
    "faults": len,
    "named": share("named"),
    "right": share("right"),
    "a healthy sensor named": lambda rows: int(rows["wrong"].sum()),
}
SIZE_CELLS: Mapping[str, Any] = {"measured": len, "holds the truth": share("holds")}
ONSET_CELLS: Mapping[str, Any] = {
    "dated": len,
    "holds the truth": share("holds"),
    "off, median (s)": lambda rows: f"{rows['off'].median():.3f}",
    "off, 90 % (s)": lambda rows: f"{rows['off'].quantile(0.9):.2f}",
    "width, median (s)": lambda rows: f"{(rows['high'] - rows['low']).median():.2f}",
    "test's (s)": lambda rows: f"{rows['as test'].median():.3f}",
}


END_CELLS: Mapping[str, Any] = {
    "named": len,
    "end told": lambda rows: share_text(int(rows["value"].notna().sum()), len(rows)),
    "holds the truth": lambda rows: share("holds")(rows[rows["low"].notna()]),
    "off, median (s)": lambda rows: f"{rows['off'].median():.3f}",
}


def draw_reliability(rows: pd.DataFrame, path: Path) -> None:
    """Draw what was stated against how often it came true."""
    import matplotlib.pyplot as plt

    judged = rows[rows["part"] == "judged"]
    of_catalogue = judged[judged["right"].astype(bool) & ~judged["family"].isin([STRANGE, SEVERAL])]
    figure, axis = plt.subplots(figsize=(5.0, 4.2), layout="constrained")
    axis.plot([0.0, 1.0], [0.0, 1.0], color="0.7", lw=1.0)
    parts = (("sensor", judged, "probability", "right"), ("kind", of_catalogue, "kind probability", "kind right"))
    for label, of, stated, right in parts:
        known = of[of[stated].notna()]
        place = np.digitize(known[stated].to_numpy(dtype=float), BINS[1:-1])
        for at in np.unique(place):
            own = known[place == at]
            if len(own) < LEAST_OF_A_KIND:
                continue
            low, high = exact_interval(int(own[right].sum()), len(own))
            x, y = own[stated].mean(), own[right].mean()
            color = "C0" if label == "sensor" else "C1"
            axis.errorbar(x, y, [[y - low], [high - y]], fmt="o", ms=4.0, color=color, label=label)
    handles, labels = axis.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axis.legend(unique.values(), unique.keys(), frameon=False, loc="upper left")
    axis.set(xlabel="stated probability", ylabel="share that came true", xlim=(0.2, 1.01), ylim=(0.2, 1.01))
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


def conduct(campaign: Campaign) -> Findings:
    """Fly, judge, report."""
    flights = QUICK.calibration if campaign.quick else several_at_once.CALIBRATION_FLIGHTS
    calibration_s = QUICK.calibration_s if campaign.quick else several_at_once.CALIBRATION_S
    size = Size(calibration=flights, calibration_s=calibration_s)
    monitor = calibrated(size, campaign.jobs, campaign.tell)
    first_seed = campaign.given.first_seed or (FIT_SEED if campaign.given.fit else FIRST_SEED)
    count = QUICK_FLIGHTS if campaign.quick else campaign.given.flights
    planned = [Flight(seed=first_seed + i, monitor=monitor) for i in range(count)]
    flown = spread(Flight.rows, planned, processes=campaign.jobs, step="flights", progress=campaign.tell)
    rows = pd.DataFrame([row for of in flown for row in of])
    if campaign.given.fit:
        return Findings(fitted(rows), False, lambda out: rows.to_csv(out / "trials.csv", index=False))
    figures = merits(rows)

    def write(out: Path) -> None:
        rows.to_csv(out / "trials.csv", index=False)
        draw_reliability(rows, out / "reliability.png")

    return Findings(report(rows, figures, size, quick=campaign.quick), is_missed(TARGETS, figures), write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the study takes."""
    parser.add_argument("--first-seed", type=int, default=0, metavar="N", help="seed of the first flight")
    parser.add_argument("--flights", type=int, default=FLIGHTS, metavar="N", help="how many are flown")
    parser.add_argument("--fit", action="store_true", help="print the odds that these flights give, and no report")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one flight", beside="trials", arguments=arguments))
