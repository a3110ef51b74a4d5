"""Hard motion of healthy sensors: stuck servos, rolls through inverted flight; and broken gyros that end in it.

    python experiments/hard_motion.py [--flights N] [--out DIR]

Flies the GTM in closed loop, on ideal sensors and on its sensor chain, and watches with a monitor of bank C-early that
was calibrated on 12 open-loop flights of 300 s with the same sensors. Servos stick at 20 s where they are, in five
combinations; the aileron is held at 4 to 20 deg for 2 or 4 s, which rolls the aircraft up to several times. No sensor
is broken there, so none may be named. Then a gyro is broken so hard that the aircraft departs: whom the monitor names,
with the rule for hard motion (`gtmbench.detectors.excursion`) and without it. The rule was made on seeds 1 to 6 and
980,001 and on; what it says of the vertical, and of faults that are dated later than motion, on 985,001 and on.

Writes report.md and rows.csv into DIR; ten minutes of one core.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.aircraft import SAMPLE_PERIOD_S, Aircraft
from gtmbench.bench.autopilot import Trim
from gtmbench.detectors.excursion import MOTION
from gtmbench.report.markup import markdown
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.values.channels import COMMANDS, GYROS, SENSORS
from studies.conduct import write_report

SEED, CALIBRATION_SEED, STUCK_S, FLIGHT_S = 985_001, 640_001, 20.0, 60.0
SERVOS = (
    ("elevator",),
    ("aileron",),
    ("rudder",),
    ("aileron", "rudder"),
    ("elevator", "aileron", "rudder", "throttle"),
)
ROLLS_DEG = (4.0, 8.0, 12.0, 16.0, 20.0)
BROKEN: tuple[Callable[[str], gb.Fault], ...] = (
    lambda channel: gb.SignFlip(channel=channel, onset_s=STUCK_S),
    lambda channel: gb.Hardover(channel=channel, onset_s=STUCK_S, limit=100.0),
    lambda channel: gb.ScaleFactor(channel=channel, onset_s=STUCK_S, factor=-2.0),
)
# lets a flight end where it leaves its envelope, as after any fault: without one that would be an error
HARMLESS = gb.Bias(channel="nx", onset_s=STUCK_S - 1.0, size=1e-9)

Held = Callable[[float, Sequence[float], Trim], Sequence[float]]


class Holding:
    """The aircraft's own autopilot, whose commands are changed on their way to the servos."""

    def __init__(self, aircraft: Aircraft, sensors: str, held: Callable[[], Held]) -> None:
        pilot = aircraft.autopilot_on(sensors)
        assert pilot is not None
        self._pilot, self._limits, self._begin = pilot, aircraft.limits, held
        self.reads = pilot.reads

    def start(self, trim: Trim) -> None:
        """Begin a flight."""
        self._trim, self._held = trim, self._begin()
        self._wanted = self._pilot.engage(trim, self._limits, SAMPLE_PERIOD_S)

    def command(self, readings: gb.Readings, time_s: float) -> Sequence[float]:
        """Return what reaches the servos."""
        acts_s = round(time_s + SAMPLE_PERIOD_S, 9)  # when the aircraft answers
        return self._held(acts_s, self._wanted(readings), self._trim)


def stuck(servos: Sequence[str]) -> Callable[[], Held]:
    """Return what servos do that stay where they are from `STUCK_S` on."""

    def begun() -> Held:
        kept: list[float] = []

        def held(time_s: float, wanted: Sequence[float], _trim: Trim) -> Sequence[float]:
            if time_s < STUCK_S:
                return wanted
            kept[:] = kept or list(wanted)
            return [was if name in servos else now for name, was, now in zip(COMMANDS, kept, wanted, strict=True)]

        return held

    return begun


def rolled(aileron_deg: float, duration_s: float) -> Callable[[], Held]:
    """Return what a pilot does who holds the aileron for a while, and the rest in trim."""

    def held(time_s: float, wanted: Sequence[float], trim: Trim) -> Sequence[float]:
        if not STUCK_S <= time_s < STUCK_S + duration_s:
            return wanted
        own = dict(zip(COMMANDS, wanted, strict=True))
        own |= {name: trim.commands[name] for name in ("elevator", "rudder")}
        own["aileron"] = trim.commands["aileron"] + aileron_deg
        return [own[name] for name in COMMANDS]

    return lambda: held


def watched(part: str, monitor: gb.Monitor, flight: gb.LoopFlight, **facts: object) -> dict[str, object]:
    """Watch a flight; return whom the alarms name in the end."""
    watch = monitor.watch(flight.sensed)
    told = [alarm for alarm in watch.alarms if alarm.is_first and not alarm.has_passed]
    named = [alarm.sensor for alarm in told if alarm.sensor is not None]
    doubts = [alarm.doubt for alarm in told if alarm.doubt]
    return {
        "part": part,
        **facts,
        "departed": flight.departed_s is not None,
        "bank_deg": round(float(np.abs(flight.truth["phi"]).max())),
        "rate_deg_s": round(float(np.linalg.norm(flight.truth.matrix(GYROS), axis=1).max())),
        "alarm": bool(told),
        "motion": MOTION in doubts,
        "first": named[0] if named else "",
        "named": " ".join(dict.fromkeys(named)),
    }


def rows(flights: int) -> Iterator[dict[str, object]]:
    """Fly and watch."""
    craft = gb.load_aircraft("gtm")
    for sensors in ("ideal", "chain"):
        calibration = CalibrationFlights(flights=12, duration_s=300.0, seed=CALIBRATION_SEED, sensors=sensors)
        monitor = gb.calibrate(calibration.sensed(SENSORS), bank=gb.load_bank("C-early"))
        told = {key: value for key, value in monitor.provenance.items() if key != "turning"}
        unruled = replace(monitor, provenance=told)
        ways = [("stuck servos", "+".join(servos), stuck(servos)) for servos in SERVOS]
        ways += [("rolls", f"{size:g} deg", rolled(size, 2.0 + 2.0 * (i % 2))) for i, size in enumerate(ROLLS_DEG)]
        for place, (part, how, held) in enumerate(ways):
            for number in range(flights if part == "stuck servos" else max(flights // 2, 1)):
                flight = gb.fly_in_loop(
                    excitation="turbulence" if number % 2 else "multisine+turbulence",
                    duration_s=FLIGHT_S,
                    seed=SEED + 100 * place + number,
                    controller=Holding(craft, sensors, held),
                    faults=HARMLESS,
                    sensors=sensors,
                )
                yield watched(part, monitor, flight, sensors=sensors, how=how, rule=True)
                yield watched(part, unruled, flight, sensors=sensors, how=how, rule=False)
        for number in range(3 * flights):
            fault = BROKEN[number // 3 % 3](GYROS[number % 3])
            flight = gb.fly_in_loop(
                excitation="turbulence", duration_s=FLIGHT_S, seed=SEED + 2000 + number, faults=fault, sensors=sensors
            )
            how = f"{fault.kind} of {fault.channel}"
            yield watched("broken gyros", monitor, flight, sensors=sensors, how=how, rule=True)
            yield watched("broken gyros", unruled, flight, sensors=sensors, how=how, rule=False)


def report(table: pd.DataFrame, flights: int) -> str:
    """Return the report as Markdown."""
    lines = []
    for (part, sensors, rule), own in table.groupby(["part", "sensors", "rule"], sort=False):
        broken = own["how"].str.split().str[-1] if part == "broken gyros" else pd.Series("", index=own.index)
        lines.append(
            {
                "part": part,
                "sensors": sensors,
                "rule": "with" if rule else "without",
                "flights": len(own),
                "departed": int(own["departed"].sum()),
                "bank beyond 130 deg": int((own["bank_deg"] > 130).sum()),
                "an alarm": int(own["alarm"].sum()),
                "can't tell: motion": int(own["motion"].sum()),
                "broken gyro named first": int(((own["first"] == broken) & (own["first"] != "")).sum()),
                "a healthy sensor named": int(
                    sum(bool(set(named.split()) - {who}) for named, who in zip(own["named"], broken, strict=True))
                ),
            }
        )
    return f"""# Hard motion of healthy sensors

`python experiments/hard_motion.py{"" if flights == 10 else f" --flights {flights}"}`. Closed loop, {FLIGHT_S:g} s, from
{STUCK_S:g} s on; seeds from {SEED} on. They were looked at when the vertical and faults dated later than motion
entered the rule: on 160 flights of two others, 5000 and 7000, a healthy sensor was named on 12 before, on none after.

{markdown(pd.DataFrame(lines))}
"""


def main() -> None:
    """Fly, watch and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=10, help="of each combination of servos (default: 10)")
    parser.add_argument("--out", type=Path, default=Path("out/hard_motion"), help="where report.md and rows.csv go")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    table = pd.DataFrame(list(rows(asked.flights)))
    table.to_csv(asked.out / "rows.csv", index=False)
    write_report(asked.out, report(table, asked.flights), asked)


if __name__ == "__main__":
    main()
