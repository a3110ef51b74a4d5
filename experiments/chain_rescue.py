"""The rescue on the sensor chain: departures unaided, with accommodation, and with an oracle.

    python experiments/chain_rescue.py [--full] [--only PART ...] [--out DIR]

Flies the GTM in turbulence on its sensor chain (`--sensors chain`), with a monitor of bank C-early calibrated on 12
open-loop flights of 300 s on that chain. Hard faults of gyros (sign flip, hardover of 100 deg/s, scale factor -2) are
flown unaided, with `gb.Accommodate`, and with an oracle that takes the sensor out 0.1 s after the onset; random faults
of gyros and of attitude angles with `gb.Accommodate`; a gyro and then, up to 10 s later, a sensor of another axis; and
healthy flights, also with a monitor that was calibrated on ideal sensors. The seeds (970,001 and on) were looked at
once; development used 900,001 and 910,001 and on, and an earlier version was held against 960,001 and on.

By default a fraction of the issue's numbers is flown, in a quarter of an hour of one core; --full flies all.
Writes report.md and rows.csv into DIR.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.detectors.accommodation.stand_in import COLUMNS, Readings, VirtualRates
from gtmbench.detectors.accommodation.without_sensor import REPLACED, SUSPECTED
from gtmbench.report.markup import markdown
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS
from in_the_loop import drawn_fault
from studies.conduct import write_report

ONSET_S, FLIGHT_S, SEED, CALIBRATION_SEED = 15.0, 40.0, 970_001, 620_001
HARD: tuple[Callable[[str, int], gb.Fault], ...] = (
    lambda channel, _: gb.SignFlip(channel=channel, onset_s=ONSET_S),
    lambda channel, sign: gb.Hardover(channel=channel, onset_s=ONSET_S, limit=100.0 * sign),
    lambda channel, _: gb.ScaleFactor(channel=channel, onset_s=ONSET_S, factor=-2.0),
)
HEALTHY, OTHER = "healthy", "healthy, monitor of ideal sensors"
PARTS = ("hard gyro faults", "angle faults", "gyro faults", "two faults", HEALTHY, OTHER)
_ORACLE_SHARE = 0.37  # of the virtual rate, as the accommodation flies on the GTM's chain


class Oracle:
    """Takes a gyro out 0.1 s after the onset, with the stand-in of the accommodation."""

    def __init__(self, gyro: str) -> None:
        self._gyro = gyro

    def start(self, sample_period_s: float, _tell: object) -> Callable[[float, Readings], Readings]:
        """Begin a flight."""
        rates = VirtualRates(4, sample_period_s)

        def hand_on(time_s: float, readings: Readings) -> Readings:
            rates.take(readings)
            if time_s < ONSET_S + 0.1:
                return readings
            flown = list(readings)
            flown[COLUMNS[self._gyro]] = _ORACLE_SHARE * rates.rate(self._gyro)
            return flown

        return hand_on


def flown(
    part: str, remedy: str, seed: int, faults: tuple[gb.Fault, ...], remedy_of: object, duration_s: float = FLIGHT_S
) -> dict[str, object]:
    """Fly once; return what became of the aircraft, and what was done."""
    begun_s = time.process_time()
    flight = gb.fly_in_loop(
        "gtm", "turbulence", duration_s, seed, faults=faults, accommodate=remedy_of, sensors="chain"
    )
    broken = {fault.channel for fault in faults}
    acted = [event for event in flight.events if event.kind in (SUSPECTED, REPLACED)]
    replaced = {event.channel for event in acted if event.kind == REPLACED}
    return {
        "part": part,
        "remedy": remedy,
        "seed": seed,
        "fault": ", ".join(f"{fault.kind} of {fault.channel}" for fault in faults) or "none",
        "departed": flight.departed_s is not None,
        "bank": bool(np.abs(flight.truth["phi"]).max() > 30.0),
        "acted": bool(acted),
        "right": bool(replaced & broken),
        "wrong": bool(replaced - broken),
        "hours": len(flight.truth) * SAMPLE_PERIOD_S / 3600.0,
        "cpu_s": time.process_time() - begun_s,
    }


def cases(part: str, count: int) -> Iterator[tuple[int, tuple[gb.Fault, ...]]]:
    """Give the seed and the faults of every flight of a part."""
    first = {"hard gyro faults": 0, "angle faults": 1000, "gyro faults": 2000, "two faults": 4000}.get(part, 3000)
    for number in range(count):
        seed = SEED + first + number
        random = np.random.default_rng(seed)
        if part == "hard gyro faults":
            yield seed, (HARD[number // 3 % 3](GYROS[number % 3], -1 if number // 9 % 2 else 1),)
        elif part == "two faults":
            axes, later_s = random.permutation(3)[:2], ONSET_S + float(random.uniform(0.0, 10.0))
            second = (GYROS, ATTITUDE)[int(random.integers(2))][axes[1]]
            yield seed, (drawn_fault(random, GYROS[axes[0]], ONSET_S), drawn_fault(random, second, later_s))
        elif part in ("angle faults", "gyro faults"):
            channel = str(random.choice(ATTITUDE if part == "angle faults" else GYROS))
            yield seed, (drawn_fault(random, channel, ONSET_S),)
        else:
            yield seed, ()


def accommodation(sensors: str) -> gb.Accommodate:
    """Return an accommodation whose monitor was calibrated on some sensors."""
    calibration = CalibrationFlights(flights=12, duration_s=300.0, seed=CALIBRATION_SEED, sensors=sensors)
    return gb.Accommodate(gb.calibrate(calibration.sensed(SENSORS), bank=gb.load_bank("C-early")))


def rows(full: bool, parts: Collection[str]) -> Iterator[dict[str, object]]:
    """Fly some parts."""
    counts = dict(zip(PARTS, (120, 174, 326, 60, 24, 24) if full else (81, 60, 40, 30, 4, 4), strict=True))
    for part in parts:
        aided = accommodation("ideal" if part == OTHER else "chain")
        duration_s = {"two faults": FLIGHT_S + 10.0}.get(part, FLIGHT_S)
        duration_s = (3000.0 if full else 600.0) if part in (HEALTHY, OTHER) else duration_s
        for seed, faults in cases(part, counts[part]):
            remedies: dict[str, object] = {"unaided": None} if part != OTHER else {}
            if part == "hard gyro faults":
                remedies["oracle"] = Oracle(faults[0].channel)
            for remedy, remedy_of in (remedies | {"accommodated": aided}).items():
                yield flown(part, remedy, seed, faults, remedy_of, duration_s)


def report(table: pd.DataFrame, full: bool) -> str:
    """Return the report as Markdown."""
    lines = [
        {
            "part": part,
            "remedy": remedy,
            "flights": len(own),
            "departed": int(own["departed"].sum()),
            "bank beyond 30 deg": int(own["bank"].sum()),
            "acted on": int(own["acted"].sum()),
            "broken sensor replaced": int(own["right"].sum()),
            "healthy sensor replaced": int(own["wrong"].sum()),
            "hours": round(float(own["hours"].sum()), 2),
            "CPU, s an hour": round(float(own["cpu_s"].sum() / own["hours"].sum())),
        }
        for (part, remedy), own in table.groupby(["part", "remedy"], sort=False)
    ]
    size = "All of the issue's numbers." if full else "A fraction of the issue's numbers; `--full` flies all."
    lost = table[(table["remedy"] == "accommodated") & (table["departed"] | table["wrong"] | table["bank"])]
    named = "\n".join(f"- seed {row.seed}, {row.part}: {row.fault}" for row in lost.itertuples()) or "None."
    return f"""# Rescue on the GTM's sensor chain

`python experiments/chain_rescue.py{" --full" if full else ""}`. {size} Turbulence, onset at {ONSET_S:g} s of
{FLIGHT_S:g}; held seeds from {SEED} on, looked at once.

{markdown(pd.DataFrame(lines))}

## With accommodation, flights that departed, banked beyond 30 deg, or had a healthy sensor replaced

{named}
"""


def main() -> None:
    """Fly and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="all of the issue's numbers: hours")
    parser.add_argument("--out", type=Path, default=Path("out/chain_rescue"), help="where report.md and rows.csv go")
    parser.add_argument("--only", nargs="*", choices=PARTS, default=PARTS, help="parts to fly, each on its own seeds")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    kept = []
    for row in rows(asked.full, asked.only):
        kept.append(row)
        table = pd.DataFrame(kept)
        table.to_csv(asked.out / "rows.csv", index=False)
        write_report(asked.out, report(table, asked.full), asked)


if __name__ == "__main__":
    main()
