"""Names in the loop: whom bank C names at each look at an alarm, where the autopilot flies by the broken sensor.

    python experiments/names_in_the_loop.py [--flights N] [--seed S] [--counts DEG] [--out DIR]

Eleven sorts of faults of each gyro and angle, of the GTM behind NASA's sensor chain, in turbulence with doublets: the
fault begins at 60 s of 85 s. A loop answers what a sensor reads, so at first a gyro's fault and its angle's resemble
each other. Bank C is calibrated on nine flights in the loop. A name is right or wrong whatever kind is told beside it;
looks come about 1, 2, 5, 10 and 20 s after the alarm. With --counts the log has angles in coarser steps than the
chain's hundredth of a degree, for calibration, too. Writes DIR/report.md.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.report.markup import markdown
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS
from studies.conduct import write_report

ONSET_S, FLIGHT_S, BEGUN_S = 60.0, 85.0, 20.0
FIRST_SEED, CALIBRATION_SEED = 747_001, 1000
LOOKS_S = (1, 2, 5, 10, 20)
SORTS: dict[str, Callable[[str, bool], gb.Fault]] = {  # of a channel, which is a gyro or not
    "tone 0.5 Hz": lambda name, gyro: tone(name, 2.0 if gyro else 1.0, 0.5),
    "tone 1 Hz": lambda name, gyro: tone(name, 2.0 if gyro else 0.6, 1.0),
    "tone 3 Hz": lambda name, gyro: tone(name, 2.0 if gyro else 0.3, 3.0),
    "lag 0.1 s": lambda name, _: gb.Lag(channel=name, onset_s=ONSET_S, lag_s=0.1),
    "lag 0.3 s": lambda name, _: gb.Lag(channel=name, onset_s=ONSET_S, lag_s=0.3),
    "half": lambda name, _: gb.ScaleFactor(channel=name, onset_s=ONSET_S, factor=0.5),
    "noise": lambda name, gyro: gb.Noise(channel=name, onset_s=ONSET_S, deviation=2.0 if gyro else 0.5),
    "bias 3": lambda name, _: gb.Bias(channel=name, onset_s=ONSET_S, size=3.0),
    "drift 0.3/s": lambda name, _: gb.Drift(channel=name, onset_s=ONSET_S, slope=0.3),
    "jam": lambda name, _: gb.Jam(channel=name, onset_s=ONSET_S),
    "deadzone 2": lambda name, _: gb.Deadzone(channel=name, onset_s=ONSET_S, half_width=2.0),
}


def tone(name: str, amplitude: float, frequency_hz: float) -> gb.Fault:
    """Return a tone on a channel."""
    return gb.Oscillation(channel=name, onset_s=ONSET_S, amplitude=amplitude, frequency_hz=frequency_hz)


def flown(
    seed: int, excitation: str, duration_s: float, faults: tuple[gb.Fault, ...] = (), *, count_deg: float = 0.0
) -> gb.Record:
    """Fly in the loop behind the sensor chain; return what the sensors read once it has settled."""
    flight = gb.fly_in_loop("gtm", excitation, duration_s, seed, faults=faults)
    record = flight.sensed.select(SENSORS).between(BEGUN_S, duration_s)
    for name in ATTITUDE if count_deg else ():
        record = record.replace(name, np.round(record[name] / count_deg) * count_deg)
    return record


def judged(monitor: gb.Monitor, seeds: range, count_deg: float) -> Iterator[dict[str, object]]:
    """Fly each fault once a seed; return a row a look at the first alarm after it began."""
    for seed in seeds:
        for name in (*GYROS, *ATTITUDE):
            for sort, fault in SORTS.items():
                broken = (fault(name, name in GYROS),)
                record = flown(seed, "doublets+turbulence", FLIGHT_S, broken, count_deg=count_deg)
                alarms = [alarm for alarm in monitor.watch(record).faults if alarm.time_s >= ONSET_S]
                for judgement in alarms[0].judgements[1:] if alarms else ():
                    said = "none" if judgement.sensor is None else "right" if judgement.sensor == name else "wrong"
                    since_s = judgement.time_s - alarms[0].time_s
                    look = min(LOOKS_S, key=lambda look_s: abs(look_s - since_s))
                    yield {"seed": seed, "sensor": name, "fault": sort, "look": look, "said": said}
        print(f"seed {seed}", file=sys.stderr, flush=True)


def shares(rows: pd.DataFrame, by: str) -> str:
    """Return a table of what was said, a row each of what it is by."""
    counted = [
        {by: key, **{said: Counter(own["said"])[said] for said in ("right", "none", "wrong")}}
        for key, own in rows.groupby(by, sort=False)
    ]
    return markdown(pd.DataFrame(counted))


def main() -> int:
    """Fly, print the report and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=4, help="of each fault (default: 4)")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the first of them")
    parser.add_argument("--counts", type=float, default=0.0, metavar="DEG", help="of the angles that are logged")
    parser.add_argument("--out", type=Path, help="folder of the report; without it, it is only printed")
    asked = parser.parse_args()
    excitations = ("multisine+turbulence", "doublets+turbulence")
    healthy = [flown(CALIBRATION_SEED + i, excitations[i % 2], 200.0, count_deg=asked.counts) for i in range(9)]
    monitor = gb.BankDetector(bank=gb.load_bank("C")).calibrate(healthy)
    rows = pd.DataFrame(judged(monitor, range(asked.seed, asked.seed + asked.flights), asked.counts))
    last = rows[rows["look"] == LOOKS_S[-1]]
    counts = f" --counts {asked.counts:g}" if asked.counts else ""
    text = "\n\n".join(
        [
            "# Names in the loop",
            f"`python experiments/names_in_the_loop.py --flights {asked.flights} --seed {asked.seed}{counts}`. "
            "Judgements that name the broken sensor, nobody, or another one.",
            f"## By the look, seconds after the alarm\n\n{shares(rows, 'look')}",
            f"## By the fault, {LOOKS_S[-1]} s after the alarm\n\n{shares(last, 'fault')}",
            f"## By the sensor, {LOOKS_S[-1]} s after the alarm\n\n{shares(last, 'sensor')}",
        ]
    )
    print(text)
    if asked.out is not None:
        asked.out.mkdir(parents=True, exist_ok=True)
        write_report(asked.out, text + "\n", asked)
    return 0


if __name__ == "__main__":
    sys.exit(main())
