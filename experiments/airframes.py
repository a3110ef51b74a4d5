"""Histories of airframes: errors that are there from power-on, drifts over flights, and healthy changes.

    python experiments/airframes.py [--airframes N] [--flights N] [--seed N] [--quick] [--jobs N] [--out DIR]

Each simulated airframe has constants of its own, and a spread from flight to flight as sensors' sheets say; its flights
are simulated (the GTM, multisine in turbulence), measured with T2's noise, judged by the engine, and entered. Of half
of the airframes the gyros drive the attitude, through an estimator of 2.5 s that learns their bias: these are
autopilots, which calibrate their gyros as they start (0.3 deg/s is left) and state their hardware; the others don't.
Every flight from the sixth on is judged beside those before. Then the last one is flown again with an error from the
first sample on, of 4 to 40 spreads; with another IMU on the same autopilot, mounted anew, and in another season. Drifts
are drawn on the constants themselves: what a flight tells them by is what it told on the simulated flights. Ends with
code 1 where a target is missed (never with --quick).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

import gtmbench as gb
from gtmbench.engine.judged import judged
from gtmbench.history.entry import OFFSET, Constant, Entry, constants_of
from gtmbench.history.overview import trends_of
from gtmbench.history.standing import stood
from gtmbench.jobs.processes import spread
from gtmbench.log.opening.engine_flight import flight_of_records
from gtmbench.report.markup import markdown
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record
from gtmbench.verdict.timeline import State
from studies.conduct import Campaign, Findings, conducted
from studies.targets import Target, held, is_missed

FLOWN_S, TRUTHS = 100.0, 10  # a flight; how many are flown: noise and constants are each flight's own
LIMIT_DEG_S = 5.0
SPREADS = (4.0, 40.0)  # of an error, evenly in its logarithm
SEASON_K, TURNED_DEG = 25.0, 5.0
LARGEST = {"bias": 20.0, "factor": 0.6, "noise": 2.5}  # deg/s, one, a logarithm: twelve times as loud
KINDS = ("bias", "factor", "noise")
HEALTHY = ("another IMU", "mounted anew", "another season")
Row = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """What a simulated airframe's gyros are like: means over flights and spreads, by axis, shape (3,) each.

    The spreads are those of the sheets of IMUs that autopilots have: 0.1 to 0.5 deg/s of a bias from power-on to
    power-on, 0.3 to 1 % of a scale, 10 to 20 % of a noise; 0.03 deg/s a kelvin.
    """

    number: int
    is_driven: bool
    offset: FloatArray
    factor: FloatArray
    noise: FloatArray
    per_k: FloatArray
    askew: FloatArray  # rad, shape (3, 3)
    spreads: Mapping[str, float]
    turned: FloatArray = field(default_factory=lambda: np.eye(3))  # from the aircraft's axes to the IMU's


@dataclass(frozen=True, kw_only=True)
class Flown:
    """A flight that was judged: its entry, what was put into it, and whom the engine accuses without a history."""

    entry: Entry
    what: str
    engine: str
    put: Mapping[str, Any] = field(default_factory=dict)


def airframe(number: int, seed: int) -> Airframe:
    """Draw an airframe."""
    random = np.random.default_rng([seed, number])
    return Airframe(
        number=number,
        is_driven=bool(number % 2),
        spreads={
            "bias": float(np.exp(random.uniform(np.log(0.1), np.log(0.5)))),
            "factor": float(np.exp(random.uniform(np.log(0.003), np.log(0.01)))),
            "noise": random.uniform(0.1, 0.2),
        },
        **_installation(random, is_driven=bool(number % 2)),
    )


def _installation(random: np.random.Generator, *, is_driven: bool) -> dict[str, FloatArray]:
    askew = np.radians(1.0) * random.standard_normal((3, 3))
    np.fill_diagonal(askew, 0.0)
    return {
        "offset": (0.3 if is_driven else 1.0) * random.standard_normal(3),
        "factor": 1.0 + 0.01 * random.standard_normal(3),
        "noise": np.exp(0.3 * random.standard_normal(3)),
        "per_k": 0.03 * random.standard_normal(3),
        "askew": askew,
    }


def _turn(random: np.random.Generator, angle: float) -> FloatArray:
    vector = random.standard_normal(3)
    return np.asarray(Rotation.from_rotvec(angle * vector / np.linalg.norm(vector)).as_matrix())


def _attitude(motion: Record, turned: FloatArray) -> FloatArray:
    """Return phi, theta and psi of an IMU that is turned in the aircraft, shape (samples, 3)."""
    aircraft = Rotation.from_euler("ZYX", motion.matrix(ATTITUDE)[:, ::-1], degrees=True)
    angles = (aircraft * Rotation.from_matrix(turned.T)).as_euler("ZYX", degrees=True)[:, ::-1]
    return np.asarray(np.unwrap(angles, axis=0, period=360.0))


@cache
def truth(seed: int) -> Record:
    """Fly, once a process."""
    return gb.fly("gtm", "multisine+turbulence", FLOWN_S, seed=seed)


def flown(
    frame: Airframe, flight: int, seed: int, what: str, *, put: Mapping[str, Any] | None = None, warmer_k: float = 0.0
) -> Flown:
    """Fly, measure, judge."""
    random = np.random.default_rng([seed, frame.number, flight])
    temperature_c = 15.0 + 6.0 * random.standard_normal() + warmer_k
    spreads = frame.spreads
    offset = frame.offset + frame.per_k * (temperature_c - 15.0) + spreads["bias"] * random.standard_normal(3)
    factor = frame.factor + spreads["factor"] * random.standard_normal(3)
    louder = frame.noise * np.exp(spreads["noise"] * random.standard_normal(3))
    if put is not None:
        axis, size = GYROS.index(put["sensor"]), put["size"]
        offset[axis] += size if what == "bias" else 0.0
        factor[axis] += size if what == "factor" else 0.0
        louder[axis] *= np.exp(size) if what == "noise" else 1.0
    motion = truth(1000 * seed + (7 * frame.number + flight) % TRUTHS)
    read = gb.measure(motion, noise="t2", seed=int(random.integers(1 << 30)))
    clean = motion.matrix(GYROS)
    noise = (read.matrix(GYROS) - clean) * louder
    gyros = clean @ frame.turned.T @ (np.diag(factor) + frame.askew).T + offset + noise
    for axis, name in enumerate(GYROS):
        read = read.replace(name, gyros[:, axis])
    if frame.is_driven:
        for name, angle in zip(ATTITUDE, _attitude(motion, frame.turned).T, strict=True):  # its own IMU's
            read = read.replace(name, angle)
        of_references = int(random.integers(1 << 30))
        read = gb.filtered_attitude(read, time_constant_s=2.5, bias_time_constant_s=20.0, seed=of_references)
    said = judged(flight_of_records([read], is_driven=frame.is_driven, is_assumed=False))
    own = Entry(
        digest=f"{frame.number} {flight}",
        log=f"{flight}",
        airframe=f"airframe {frame.number}",
        hardware="known" if frame.is_driven else "",
        temperature_c=float(temperature_c),
        constants=constants_of(said),
    )
    return Flown(entry=own, what=what, engine=" ".join(dict.fromkeys(name for name, _ in said.accused)), put=put or {})


def flown_of(number: int, *, flights: int, seed: int) -> list[Flown]:
    """Fly an airframe: its flights, then the last one again with errors and with healthy changes."""
    frame, random = airframe(number, seed), np.random.default_rng([seed, 77, number])
    last = flights - 1
    found = [flown(frame, flight, seed, "healthy") for flight in range(flights)]
    for kind in KINDS if not frame.is_driven else ("bias", "noise"):  # an attitude takes part in its gyros' factors
        spreads = float(np.exp(random.uniform(*np.log(SPREADS))))
        sign = 1.0 if kind == "noise" else float(random.choice([-1.0, 1.0]))  # a gyro that is quieter hasn't failed
        size = sign * min(spreads * frame.spreads[kind], LARGEST[kind])
        put = {"sensor": str(random.choice(GYROS)), "size": size, "spreads": abs(size) / frame.spreads[kind]}
        found.append(flown(frame, last, seed, kind, put=put))
    other = replace(frame, **_installation(random, is_driven=frame.is_driven))
    turned = replace(frame, turned=_turn(random, np.radians(TURNED_DEG)))
    found.append(flown(other, last, seed, HEALTHY[0]))
    found.append(flown(turned, last, seed, HEALTHY[1]))
    found.append(flown(frame, last, seed, HEALTHY[2], warmer_k=float(random.choice([-SEASON_K, SEASON_K]))))
    return found


def judged_rows(every: Sequence[Flown], *, is_driven: bool) -> list[Row]:
    """Judge flights beside those before them, in order; return a row each."""
    known: list[Entry] = []
    rows: list[Row] = []
    healthy = [each for each in every if each.what == "healthy"]
    for number, each in enumerate([*healthy, *(each for each in every if each.what != "healthy")]):
        began = time.process_time()
        standing = stood(known, each.entry)
        claims = standing.claims((0.0, FLOWN_S))
        ms = 1e3 * (time.process_time() - began)
        named = {name: span.state for name, span in claims if span.state in (State.FAILED, State.SUSPECTED)}
        rows.append(
            {
                "airframe": each.entry.airframe,
                "driven": is_driven,
                "what": each.what,
                "flight": number,
                "accused": " ".join(named),
                "failed": " ".join(name for name, state in named.items() if state is State.FAILED),
                "engine": each.engine,
                "why": "; ".join(dict.fromkeys([*(span.reason for _, span in claims), *standing.lines])),
                "begins": standing.begins,
                "ms": ms,
                **each.put,
            }
        )
        if number < len(healthy) - 1:
            known.append(standing.entered([]))
    return rows


def conducted_of(number: int, *, flights: int, seed: int) -> list[Row]:
    """Fly an airframe, judge its flights, and let a bias of it drift."""
    own, frame = flown_of(number, flights=flights, seed=seed), airframe(number, seed)
    deviations = [own[flights - 1].entry.by_key[gyro, OFFSET].deviation for gyro in GYROS]
    drift = drifting(frame, np.random.default_rng([seed, 78, number]), deviations, flights)
    return [*judged_rows(own, is_driven=frame.is_driven), drift]


def drifting(frame: Airframe, random: np.random.Generator, deviations: Sequence[float], flights: int) -> Row:
    """Draw flights of which a gyro's bias grows until its limit, and tell when that is said."""
    axis, sign = int(random.integers(3)), float(random.choice([-1.0, 1.0]))
    start = float(np.clip(frame.offset[axis], -2.0, 2.0))
    crossing = float(random.uniform(1.0 * flights, 3.0 * flights))
    slope = (sign * LIMIT_DEG_S - start) / (crossing - 1.0)
    known: list[Entry] = []
    found: list[Any] = []
    wrong = False
    for flight in range(1, int(np.ceil(crossing))):
        means = np.where(np.arange(3) == axis, start + slope * (flight - 1), frame.offset)
        values = means + np.hypot(frame.spreads["bias"], deviations) * random.standard_normal(3)
        constants = tuple(
            Constant(sensor=gyro, name=OFFSET, value=float(value), deviation=deviation)
            for gyro, value, deviation in zip(GYROS, values, deviations, strict=True)
        )
        known.append(Entry(digest=str(flight), log="", airframe="a", temperature_c=15.0, constants=constants))
        told = trends_of(known)
        found += [each for each in told if each.sensor == GYROS[axis]]
        wrong |= any(each.sensor != GYROS[axis] for each in told)
    inside = [each.between[0] <= crossing <= each.between[1] for each in found]
    return {
        "airframe": f"airframe {frame.number}",
        "driven": frame.is_driven,
        "what": "drift",
        "crossing": crossing,
        "found": bool(found),
        "first": found[0].flights if found else np.nan,
        "inside": float(np.mean(inside)) if inside else np.nan,
        "inside_first": float(inside[0]) if inside else np.nan,
        "wrong": wrong,
    }


def report(rows: pd.DataFrame, flights: int) -> tuple[list[str], bool]:
    """Return the report's tables, and whether a target is missed."""
    healthy, changed = rows[rows["what"] == "healthy"], rows[rows["what"].isin(HEALTHY)]
    broken, drifts = rows[rows["what"].isin(KINDS)].copy(), rows[rows["what"] == "drift"]
    broken["found"] = [row.sensor in f"{row.accused} {row.engine}".split() for row in broken.itertuples()]
    broken["alone"] = [row.sensor in f"{row.failed} {row.engine}".split() for row in broken.itertuples()]
    broken["wrong"] = [bool({*row.failed.split()} - {row.sensor}) for row in broken.itertuples()]
    broken["before"] = [row.sensor in row.engine.split() for row in broken.itertuples()]
    by_kind = broken.groupby(["what", "driven"]).agg(
        errors=("found", "size"),
        found=("found", "mean"),
        named_alone=("alone", "mean"),
        wrong=("wrong", "sum"),
        without_history=("before", "mean"),
    )
    bands = pd.cut(broken["spreads"], [0, 6, 8, 12, 20, 100])
    by_size = broken.groupby(bands, observed=True).agg(errors=("found", "size"), found=("found", "mean"))
    figures = {
        "": {
            "found": float(broken["found"].mean()),
            "wrong": float(broken["wrong"].sum()),
            "accused": float(healthy[healthy["accused"] != ""]["airframe"].nunique()),
            "before": float(drifts["found"].astype(float).mean()),
            "inside": float(drifts["inside"].mean()),
            "changed": float((changed["accused"] != "").sum()),
            "ms": float(rows.loc[rows["flight"] >= flights - 2, "ms"].median()),
        }
    }
    targets = [
        Target("an error throughout: found and named, the gyro alone or one of two", "", "found", ">=", 0.9),
        Target("a healthy gyro named", "", "wrong", "<=", 0.0),
        Target("healthy airframes accused", "", "accused", "<=", 0.0),
        Target("drifts: found before the limit", "", "before", ">=", 0.8),
        Target("drifts: the crossing inside its interval", "", "inside", ">=", 0.9),
        Target("another IMU, mounted anew, another season: accused", "", "changed", "<=", 0.0),
        Target("median of a flight beside its history, ms of CPU", "", "ms", "<=", 5.0),
    ]
    seen = changed.groupby("what").agg(
        flights=("accused", "size"),
        accused=("accused", lambda names: int((names != "").sum())),
        told=("begins", "sum"),
    )
    said = [
        f"Healthy flights judged: {int((healthy['flight'] >= 5).sum())}, of {healthy['airframe'].nunique()} airframes; "
        f"an installation said to begin in {int(healthy['begins'].sum())} of them.",
        f"Drifts: {len(drifts)}, first told after {drifts['first'].median():.0f} flights in the median, then the "
        f"crossing inside its interval in {drifts['inside_first'].mean():.0%}; another gyro said to drift in "
        f"{int(drifts['wrong'].sum())}.",
    ]
    text = [
        "## Targets",
        markdown(held(targets, figures)),
        "## Errors from the first sample on, by kind",
        markdown(by_kind.round(3).reset_index()),
        "## By size, in spreads",
        markdown(by_size.round(3).reset_index().astype({"spreads": str})),
        "## Healthy changes",
        markdown(seen.reset_index()),
        *said,
    ]
    return text, is_missed(targets, figures)


def conduct(campaign: Campaign) -> Findings:
    """Fly, judge, report."""
    given = campaign.given
    airframes, flights = (2, 7) if campaign.quick else (given.airframes, given.flights)
    work: Callable[[int], list[Row]] = partial(conducted_of, flights=flights, seed=given.seed)
    done: Sequence[list[Row]] = spread(
        work, range(airframes), processes=campaign.jobs, step="airframes", progress=campaign.tell
    )
    rows = pd.DataFrame([row for own in done for row in own])
    text, missed = report(rows, flights)
    quick = ["**Quick: two airframes of seven flights. It shows that the script runs, and bounds nothing.**"]
    head = ["# Histories of airframes", *(quick if campaign.quick else []), str(__doc__).partition("\n\n")[2]]

    def write(out: Path) -> None:
        rows.to_csv(out / "rows.csv", index=False)

    return Findings("\n\n".join([*head, *text]) + "\n", missed, write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add how much is flown."""
    parser.add_argument("--airframes", type=int, default=40, help="simulated (default: %(default)s)")
    parser.add_argument("--flights", type=int, default=20, help="of each (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=74, help="of all draws (default: %(default)s)")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="two airframes of seven flights", arguments=arguments))
