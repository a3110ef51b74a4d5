"""A magnetometer as witness between the yaw gyro and the heading: who is accused, on flights that nobody tuned on.

    python experiments/heading_witness.py [--seeds FIRST:LAST] [--out DIR]

Every flight of the GTM has a magnetometer (50 Hz, noise 0.5 % of the field, soft iron 3 %, field and iron drawn by the
seed) and an attitude of a filter of 20 s that the gyros drive. After 120 healthy seconds, for 30 s, one of these is
wrong: r, another gyro, the heading alone, or the magnetometer together with the heading that follows it. What r reads
more than the heading turns is put to `gtmbench.method.magnetometer_witness`. Prints a table, writes it into
DIR/report.md, and ends with code 1 where a healthy gyro is accused.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.other_sensors import Magnetometer, with_magnetometer
from gtmbench.log.self_check.motion import attitude_rates
from gtmbench.method.magnetometer_witness import HeadingWitness
from gtmbench.report.markup import markdown
from gtmbench.values.channels import ATTITUDE, MAGNETOMETER
from gtmbench.values.record import Record
from studies.conduct import write_report

LEARNT_S, LASTS_S, SETTLED_S = 120.0, 30.0, 20.0
TAU_S = 20.0
LEAST_DEG_S = 0.3  # of a difference that anybody asks about
OTHERS = ("bias of p", "bias of q")
INTRODUCTION = """The yaw gyro and a heading that the gyros drive (a filter of 20 s) differ for 30 s; a magnetometer
that was learnt on 100 healthy seconds says which is wrong. *asked*: cases in which the difference is 0.3 deg/s or more.
Right is *r* for its faults, *psi* where the heading wanders alone, *magnetometer* where it is disturbed and the heading
follows it. For a fault of another gyro, asked as if r differed by 1 deg/s, every name is wrong. *r* where r is
healthy is a healthy gyro accused.
"""


def cases(seed: int, excitation: str) -> Iterator[tuple[str, str, Record, HeadingWitness]]:
    """Give what is wrong, its size, the flight, and the witness that its healthy part taught."""
    drawn = np.random.default_rng([seed, *excitation.encode()])
    truth = gb.fly("gtm", excitation, LEARNT_S + LASTS_S + 10.0, seed=seed)
    magnetometer = Magnetometer(inclination_deg=drawn.uniform(40, 75), declination_deg=drawn.uniform(-20, 20))
    sensed = with_magnetometer(gb.measure(truth, noise="t2", seed=seed), truth, magnetometer, seed=seed)
    for name in ATTITUDE:
        sensed = sensed.replace(name, truth[name])
    healthy = gb.filtered_attitude(sensed, time_constant_s=TAU_S, seed=seed)
    witness = HeadingWitness(healthy=(healthy.between(SETTLED_S, LEARNT_S),))
    elapsed = np.maximum(healthy.time_s - LEARNT_S, 0.0)
    for gyro, sizes in (("r", (1.0, 2.0, 3.0, 5.0)), ("p", (3.0,)), ("q", (3.0,))):
        for size in sizes:
            fault = gb.Bias(channel=gyro, onset_s=LEARNT_S, size=size * drawn.choice([-1, 1]))
            broken = gb.filtered_attitude(gb.inject(sensed, fault), time_constant_s=TAU_S, seed=seed)
            yield f"bias of {gyro}", f"{size:g} deg/s", broken, witness
    for slope in (0.1, 0.3):
        fault = gb.Drift(channel="r", onset_s=LEARNT_S, slope=slope * drawn.choice([-1, 1]))
        broken = gb.filtered_attitude(gb.inject(sensed, fault), time_constant_s=TAU_S, seed=seed)
        yield "drift of r", f"{slope:g} deg/s²", broken, witness
    for rate in (1.0, 3.0):
        wander = rate * drawn.choice([-1, 1]) * elapsed
        yield "heading alone", f"{rate:g} deg/s", healthy.replace("psi", healthy["psi"] + wander), witness
    for share in (0.1, 0.3, 1.0):
        for shape in ("ramp", "step"):
            yield f"magnetometer, {shape}", f"{share:g} of the field", _disturbed(healthy, share, shape, drawn), witness


def _disturbed(healthy: Record, share: float, shape: str, drawn: np.random.Generator) -> Record:
    """Return a flight with a magnetometer beside a growing or switched current, and a heading that follows it."""
    direction = drawn.standard_normal(3)
    elapsed = np.maximum(healthy.time_s - LEARNT_S, 0.0) / LASTS_S
    grown = elapsed if shape == "ramp" else (elapsed > drawn.uniform(0.2, 0.8)).astype(float)
    field = healthy.matrix(MAGNETOMETER)
    strength = np.nanmean(np.linalg.norm(field, axis=1))
    disturbed = field + share * strength * np.outer(grown, direction / np.linalg.norm(direction))
    turned = np.nan_to_num(np.rad2deg(_azimuth(healthy, disturbed) - _azimuth(healthy, field)))
    read = np.isfinite(field).all(axis=1)
    smooth = np.interp(healthy.time_s, healthy.time_s[read], np.unwrap(turned[read], period=360.0))
    record = healthy.replace("psi", healthy["psi"] - smooth)
    for axis, name in enumerate(MAGNETOMETER):
        record = record.replace(name, disturbed[:, axis])
    return record


def _azimuth(record: Record, field: np.ndarray) -> np.ndarray:
    """Return the direction of the levelled field, in radians."""
    phi, theta = np.deg2rad(record["phi"]), np.deg2rad(record["theta"])
    x, y, z = field.T
    forward = x * np.cos(theta) + (y * np.sin(phi) + z * np.cos(phi)) * np.sin(theta)
    return np.asarray(np.arctan2(y * np.cos(phi) - z * np.sin(phi), forward))


def asked(seed: int, excitation: str) -> Iterator[dict[str, object]]:
    """Give what the witness said about each case of a flight."""
    for wrong, size, record, witness in cases(seed, excitation):
        error = record["r"] - attitude_rates(record)[:, 2]
        rows = record.sample_range(LEARNT_S, LEARNT_S + LASTS_S)
        claimed = float(np.nanmean(error[rows.start : rows.stop]))
        if wrong in OTHERS:  # the heading hardly shows them; asked as if somebody suspected r nevertheless
            claimed = float(np.copysign(1.0, claimed))
        elif abs(claimed) < LEAST_DEG_S:
            continue
        opinion = witness.judge(record, LEARNT_S, LEARNT_S + LASTS_S, error_deg_s=claimed)
        said = {"seed": seed, "excitation": excitation, "claimed": claimed, "reason": opinion.reason}
        yield {"wrong": wrong, "size": size, "said": opinion.sensor or "can't tell", **said}


def main() -> int:
    """Fly, ask, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="100:110")
    parser.add_argument("--out", type=Path, default=Path("experiments/reports/heading_witness"))
    given = parser.parse_args()
    first, last = (int(each) for each in given.seeds.split(":"))
    flown = [(seed, air) for seed in range(first, last) for air in ("multisine+turbulence", "dissertation")]
    rows = pd.DataFrame([row for each in flown for row in asked(*each)])
    table = pd.crosstab([rows["wrong"], rows["size"]], rows["said"])
    table.insert(0, "asked", table.sum(axis=1))
    table = table.reset_index()
    gyros = (rows["said"] == "r") & ~rows["wrong"].str.endswith(" of r")
    lines = [f"# A magnetometer between r and psi (seeds {first} to {last - 1})", INTRODUCTION, markdown(table)]
    lines.append(f"Healthy gyros accused: {int(gyros.sum())} of {len(rows)} cases.\n")
    given.out.mkdir(parents=True, exist_ok=True)
    write_report(given.out, "\n\n".join(lines), given)
    rows.to_csv(given.out / "cases.csv", index=False)
    print("\n\n".join(lines))
    return int(gyros.any())


if __name__ == "__main__":
    sys.exit(main())
