"""Surfaces that fail, told from sensors that fail: who is accused, and which surface is named.

    python experiments/surface_faults.py [--flights N] [--hours H] [--seed S] [--quick] [--out DIR]

Flies the GTM on its sensor chain, in the loop and open loop. `surfaces` and bank C learn on the same 24 healthy
flights of 300 s at the aircraft's own trim, half of them in the loop, in the bench's usual turbulence.

1. Surfaces: six kinds x elevator, aileron, rudder x flights with doublets and turbulence, 220 s, broken at 100 s and
   watched for 60 s from then on. A fault moves the aircraft by more than its noise and gusts if the RMS of what the
   surface did less what was commanded, over 20 s behind the monitor's own 2 rad/s lag, is at least what gusts and
   sensors amount to in degrees of that surface (what a minute of healthy flight leaves).
2. Throttle: five kinds, likewise, watched for 110 s; it moves the aircraft by its thrust, in percent of throttle.
3. Sensors: six kinds x gyros, angles and air data; bank C alone and with `surfaces` beside it.
4. Healthy flight: light, the usual, moderate and severe turbulence at trims that neither learnt.
5. Logs: the flights of 1 to 4 as a log that somebody hands over, which nobody learnt on, with and without vanes. Asked
   for by `--parts logs`.

Seeds of development are 1,010,001 and on, those of the report 1,020,001 and on, looked at once.

Writes report.md and rows.csv into DIR; about an hour of one core.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.excitation import excitation as named
from gtmbench.detectors.alarm import MISSING
from gtmbench.engine.course.judged import course_beside
from gtmbench.engine.judged import judged
from gtmbench.engine.samples import Samples, flight_of
from gtmbench.report.markup import markdown
from gtmbench.values.channels import COMMANDS, SENSORS, SURFACES
from gtmbench.values.clock import even_times_s
from studies.conduct import write_report

HELD_SEED, CALIBRATION_SEED = 1_020_001, 960_001
ALL_PARTS = "surfaces,throttle,sensors,healthy"
THROTTLE_TIMES = 2  # as many flights: it has five rows of kinds, where surfaces have eighteen
KEPT = 20  # rows, between two times that they are written
ONSET_S, FLIGHT_S, HEALTHY_S, BEGUN_S = 100.0, 220.0, 400.0, 10.0
WATCHED_S = {"surfaces": 60.0, "throttle": 110.0, "sensors": 60.0}  # from the onset on
KINDS = {
    "jam": lambda at: gb.Jam(**at),
    "half effective": lambda at: gb.ScaleFactor(**at, factor=0.5),
    "offset 1 deg": lambda at: gb.Bias(**at, size=1.0),
    "runaway to 8 deg": lambda at: gb.Hardover(**at, limit=8.0, rate_limit=30.0),
    "backlash 2 deg": lambda at: gb.Hysteresis(**at, width=2.0),
    "slow servo 0.3 s": lambda at: gb.Lag(**at, lag_s=0.3),
}
# What each shows as: a runaway is as stuck as a jam; backlash has no word of its own, so that any is wrong.
SAID = {
    "jam": "jam",
    "half effective": "scale_factor",
    "offset 1 deg": "bias",
    "runaway to 8 deg": "jam",
    "backlash 2 deg": "none of these",
    "slow servo 0.3 s": "lag",
}
OF_THROTTLE = {
    "engine out": lambda at: gb.ScaleFactor(**at, factor=0.0),
    "stuck": lambda at: gb.Jam(**at),
    "half the command": lambda at: gb.ScaleFactor(**at, factor=0.5),
    "slow 2 s": lambda at: gb.Lag(**at, lag_s=2.0),
    "runaway to full": lambda at: gb.Hardover(**at, limit=100.0, rate_limit=50.0),
}
SAID |= {"engine out": "jam", "stuck": "jam", "half the command": "scale_factor", "slow 2 s": "lag"}
SAID |= {"runaway to full": "jam"}
SENSOR_FAULTS = {
    "bias": lambda at: gb.Bias(**at, size=SIZES[at["channel"]]),
    "drift": lambda at: gb.Drift(**at, slope=SIZES[at["channel"]] / 10.0),
    "jam": lambda at: gb.Jam(**at),
    "scale 0.7": lambda at: gb.ScaleFactor(**at, factor=0.7),
    "oscillation 1 Hz": lambda at: gb.Oscillation(**at, amplitude=SIZES[at["channel"]], frequency_hz=1.0),
    "noise": lambda at: gb.Noise(**at, deviation=2.0 * SIZES[at["channel"]]),
}
SIZES = {"p": 2.0, "q": 2.0, "r": 2.0, "phi": 2.0, "theta": 2.0, "psi": 2.0, "alpha": 1.0, "beta": 1.0}
SIZES |= {"nx": 0.05, "ny": 0.05, "nz": 0.1, "tas": 5.0}
GUSTS = {"light": 2, "usual": 3, "moderate": 4, "severe": 6}  # severities of MIL-F-8785C, as JSBSim counts them
TRIMS = ({}, {"tas_kt": 88.0}, {"tas_kt": 125.0}, {"altitude_ft": 1500.0}, {"altitude_ft": 15_000.0, "tas_kt": 115.0})


def in_air(excitation: str, gusts: str, duration_s: float, seed: int) -> gb.Excitation:
    """Return the GTM's excitation of a name, in some gusts."""
    count = round(duration_s / SAMPLE_PERIOD_S) + 1
    time_s = even_times_s(0.0, SAMPLE_PERIOD_S, range(count))
    return replace(named(excitation, time_s, seed).scaled(gb.load_aircraft("gtm").excitation), severity=GUSTS[gusts])


def flown(
    loop: bool,
    seed: int,
    faults: Sequence[gb.Fault] = (),
    *,
    excitation: str = "doublets+turbulence",
    duration_s: float = FLIGHT_S,
    gusts: str = "usual",
    **trim: float,
) -> tuple[gb.Record, gb.Record, float]:
    """Return truth, readings with commands, and when the aircraft departed (infinite: never)."""
    moved = in_air(excitation, gusts, duration_s, seed)
    if loop:
        flight = gb.fly_in_loop("gtm", moved, duration_s, seed, faults=faults, **trim)
        departed = np.inf if flight.departed_s is None else flight.departed_s
        return flight.truth, flight.readings(commands=True), departed
    of_surfaces = tuple(fault for fault in faults if fault.channel in COMMANDS)
    truth = gb.fly("gtm", moved, duration_s, seed, faults=of_surfaces, **trim)
    chain = gb.load_aircraft("gtm").chain
    readings = gb.measure(truth, noise="t2", seed=seed, commands=True, sensors=chain)
    readings = gb.inject(readings, [fault for fault in faults if fault.channel not in COMMANDS])
    bounds = gb.load_aircraft("gtm").departure
    outside = np.any([(truth[name] < low) | (truth[name] > high) for name, (low, high) in bounds.items()], axis=0)
    return truth, readings, float(truth.time_s[np.argmax(outside)]) if outside.any() else np.inf


def monitors() -> dict[str, gb.Monitor]:
    """Calibrate both detectors on the same healthy flights."""
    records = []
    for number in range(24):
        excitation = "multisine+turbulence" if number % 4 < 2 else "doublets+turbulence"
        loop = number % 2 == 1
        _, readings, _ = flown(loop, CALIBRATION_SEED + number, excitation=excitation, duration_s=300.0)
        records.append(readings.between(BEGUN_S, readings.end_s))
    # every third identifies: of these, too, half are flown in the loop
    surfaces = gb.find_detector("surfaces").calibrate(records)
    bank = gb.find_detector("C").calibrate([record.select(SENSORS) for record in records])
    return {"surfaces": surfaces, "C": bank}


def told(watch: gb.Watch, from_s: float, until_s: float) -> list[gb.detectors.alarm.Alarm]:
    """Return the faults that a monitor tells of between two times."""
    return [
        alarm
        for alarm in watch.alarms
        if alarm.is_first and alarm.test != MISSING and from_s <= alarm.time_s <= until_s and not alarm.has_passed
    ]


def accused(alarms: Sequence[gb.detectors.alarm.Alarm]) -> list[str]:
    """Return the sensors, or surfaces, that are named without a doubt."""
    return [alarm.sensor for alarm in alarms if alarm.sensor is not None and not alarm.doubt]


def kinds_said(alarms: Sequence[gb.detectors.alarm.Alarm]) -> str:
    """Return the kinds that are told of the surfaces that are named: the last word of each alarm that has one."""
    told = [[each.kind for each in alarm.judgements if each.kind] for alarm in alarms if alarm.sensor is not None]
    return " ".join(dict.fromkeys(kinds[-1] for kinds in told if kinds))


def noise_of(monitor: gb.SurfaceMonitor, surface: str) -> float:
    """Return what gusts and sensors amount to, in degrees of a surface or percent of throttle."""
    place = monitor.suspects.index(surface)
    return float(monitor.normal.noise[place] * monitor.answer.frame.steps[place])


def lagged(values: gb.values.record.FloatArray, lag_s: float, period_s: float) -> gb.values.record.FloatArray:
    """Return values behind a lag of first order, at rest in the first of them."""
    from scipy.signal import lfilter

    pole = np.exp(-period_s / lag_s)
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], values - values[0]) + values[0])


def moved_by(monitor: gb.SurfaceMonitor, truth: gb.Record, surface: str) -> float:
    """Return the RMS of what a surface did less the command, behind a lag of 2 rad/s, over 20 s from the onset.

    Of the throttle it is the thrust that an engine as it was identified makes of either, in percent of throttle.
    """
    both = [truth[f"{surface}_actual"], truth[surface]]
    engine = monitor.answer.frame.engine
    if surface == "throttle":
        for _ in range(engine.lags):
            both = [lagged(each, engine.lag_s, truth.sample_period_s) for each in both]
        both = [engine.thrust(each) for each in both]
    slow = lagged(both[0] - both[1], 0.5, truth.sample_period_s)
    since = (truth.time_s >= ONSET_S) & (truth.time_s < ONSET_S + 20.0)
    return float(np.sqrt(np.mean(np.square(slow[since])))) if since.any() else 0.0


def surface_rows(
    both: dict[str, gb.Monitor], flights: int, seed: int, part: str = "surfaces"
) -> Iterator[dict[str, object]]:
    """Break surfaces, or the throttle."""
    kinds, broken = (KINDS, SURFACES) if part == "surfaces" else (OF_THROTTLE, ("throttle",))
    for number in range(flights):
        for loop in (True, False):
            for kind, made in kinds.items():
                for surface in broken:
                    fault = made({"channel": surface, "onset_s": ONSET_S})
                    truth, readings, departed_s = flown(loop, seed + number, (fault,))
                    until_s = min(ONSET_S + WATCHED_S[part], truth.end_s)
                    record = readings.between(BEGUN_S, until_s)
                    watch = both["surfaces"].watch(record)
                    alarms, before = told(watch, ONSET_S, until_s), told(watch, 0.0, ONSET_S - 1e-9)
                    names = accused(alarms)
                    bank = told(both["C"].watch(record), 0.0, until_s)
                    yield {
                        "part": part,
                        "loop": loop,
                        "kind": kind,
                        "channel": surface,
                        "seed": seed + number,
                        "departed_s": departed_s,
                        "moved": moved_by(both["surfaces"], truth, surface) / noise_of(both["surfaces"], surface),
                        "alarm_s": alarms[0].time_s - ONSET_S if alarms else np.nan,
                        "named_s": min((a.isolated_s for a in alarms if a.isolated_s), default=np.nan) - ONSET_S,
                        "named": " ".join(dict.fromkeys(names)),
                        "kind_said": kinds_said(alarms),
                        "said": " | ".join(alarm.verdict for alarm in alarms),
                        "early": len(before),
                        "C_accuses": " ".join(accused(bank)),
                        "C_said": " | ".join(alarm.verdict for alarm in bank),
                    }


def sensor_rows(both: dict[str, gb.Monitor], flights: int, seed: int) -> Iterator[dict[str, object]]:
    """Break sensors."""
    for number in range(flights):
        for loop in (True, False):
            for kind, made in SENSOR_FAULTS.items():
                for channel in SIZES:
                    fault = made({"channel": channel, "onset_s": ONSET_S})
                    truth, readings, departed_s = flown(loop, seed + 500 + number, (fault,))
                    until_s = min(ONSET_S + WATCHED_S["sensors"], truth.end_s)
                    record = readings.between(BEGUN_S, until_s)
                    alone = told(both["C"].watch(record.select(SENSORS)), 0.0, until_s)
                    alarms = told(both["surfaces"].watch(record), 0.0, until_s)
                    beside = told(both["C"].watch(record), 0.0, until_s) if number == 0 else alone
                    yield {
                        "part": "sensors",
                        "loop": loop,
                        "kind": kind,
                        "channel": channel,
                        "seed": seed + 500 + number,
                        "departed_s": departed_s,
                        "named": " ".join(dict.fromkeys(accused(alarms))),
                        "said": " | ".join(alarm.verdict for alarm in alarms),
                        "C_accuses": " ".join(accused(alone)),
                        "C_said": " | ".join(alarm.verdict for alarm in alone),
                        "C_same": [a.verdict for a in alone] == [a.verdict for a in beside],
                    }


def healthy_rows(both: dict[str, gb.Monitor], hours: float, seed: int) -> Iterator[dict[str, object]]:
    """Fly healthy, at trims that nobody learnt, in turbulence up to severe."""
    flights = int(np.ceil(hours * 3600.0 / (HEALTHY_S - BEGUN_S)))
    for number in range(flights):
        gusts = list(GUSTS)[number % len(GUSTS)]
        trim = TRIMS[number // len(GUSTS) % len(TRIMS)]
        loop = number % 5 != 4  # severe gusts throw an open loop out of its envelope sooner or later
        excitation = ("turbulence", "doublets+turbulence", "multisine+turbulence")[number % 3]
        if not loop:
            gusts = "usual" if gusts == "severe" else gusts
        try:
            _, readings, departed_s = flown(
                loop,
                seed + 1000 + number,
                excitation=excitation,
                duration_s=HEALTHY_S,
                gusts=gusts,
                **trim,
            )
            record = readings.between(BEGUN_S, min(readings.end_s, departed_s))
        except gb.errors.GtmbenchError as error:  # thrown out of its envelope, at the latest before it is watched
            yield {
                "part": "healthy",
                "loop": loop,
                "kind": gusts,
                "seed": seed + 1000 + number,
                "said": f"not flown: {error}",
            }
            continue
        watch = both["surfaces"].watch(record)
        alarms = told(watch, 0.0, np.inf)
        bank = told(both["C"].watch(record), 0.0, np.inf)
        yield {
            "part": "healthy",
            "loop": loop,
            "kind": gusts,
            "channel": ", ".join(f"{name} {value:g}" for name, value in trim.items()),
            "seed": seed + 1000 + number,
            "departed_s": departed_s,
            "hours": watch.armed_hours,
            "peak": max(score.peak() for score in watch.scores.values()),
            "named": " ".join(dict.fromkeys(accused(alarms))),
            "said": " | ".join(alarm.verdict for alarm in alarms),
            "C_accuses": " ".join(accused(bank)),
        }


def log_rows(flights: int, seed: int) -> Iterator[dict[str, object]]:
    """Break surfaces, throttle, sensors or nothing, and judge each flight as a log alone, with vanes and without."""
    of_surfaces = [(kind, made, channel) for kind, made in KINDS.items() for channel in SURFACES]
    of_throttle = [(kind, made, "throttle") for kind, made in OF_THROTTLE.items()]
    of_sensors = [(kind, made, channel) for kind, made in SENSOR_FAULTS.items() for channel in SIZES]
    for number in range(flights):
        for loop in (True, False):
            healthy = [("healthy", None, f"{gusts} {trim}") for gusts in GUSTS for trim in range(len(TRIMS))]
            for place, (kind, made, channel) in enumerate([*of_surfaces, *of_throttle, *of_sensors, *healthy]):
                faults = () if made is None else (made({"channel": channel, "onset_s": ONSET_S}),)
                gusts, trim = (channel.split()[0], TRIMS[int(channel.split()[1])]) if made is None else ("usual", {})
                try:
                    _, readings, departed_s = flown(
                        loop, seed + 100 * number + place, faults, gusts=gusts if loop else "usual", **trim
                    )
                except gb.errors.GtmbenchError:  # thrown out of its envelope
                    continue
                record = readings.between(BEGUN_S, min(readings.end_s, departed_s))
                row = {"loop": loop, "kind": kind, "channel": channel, "departed_s": departed_s}
                yield row | {f"named{sight}": as_log(record, sight == "") for sight in ("", "_no_vanes")}


def as_log(record: gb.Record, has_vanes: bool) -> str:
    """Return which surface the engine names on a record alone; "" for none."""
    left_out = () if has_vanes else ("alpha", "beta")
    samples = {name: Samples(record.time_s, record[name]) for name in record.channels if name not in left_out}
    said = course_beside(judged(flight_of(samples, is_driven=False)), samples).commands
    return (said.named or "") if said else ""


def log_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a line for every kind of what was broken, as logs alone tell it."""
    breaks = (
        rows["channel"].where(rows["channel"].isin(COMMANDS), "sensors").where(rows["kind"] != "healthy", "nothing")
    )
    lines = []
    for (loop, broken), own in rows.groupby(["loop", breaks], sort=False):
        line: dict[str, object] = {"loop": "closed" if loop else "open", "broken": broken, "flights": len(own)}
        for sight, title in (("", ""), ("_no_vanes", ", without vanes")):
            named = own[f"named{sight}"]
            line[f"named right{title}"] = int((named == own["channel"]).sum())
            line[f"named wrong{title}"] = int(((named != "") & (named != own["channel"])).sum())
        lines.append(line)
    return pd.DataFrame(lines)


def surface_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a line for every kind, in the loop and without."""
    lines = []
    for (loop, kind), own in rows.groupby(["loop", "kind"], sort=False):
        moves = own[own["moved"] >= 1.0]
        right = moves["named"] == moves["channel"]
        wrong = own["named"].str.split().map(len).gt(0) & (own["named"] != own["channel"])
        lines.append(
            {
                "loop": "closed" if loop else "open",
                "kind": kind,
                "flights": len(own),
                "move": len(moves),
                "of these named right": int(right.sum()),
                "can't tell": int(((moves["named"] == "") & moves["alarm_s"].notna()).sum()),
                "missed": int(moves["alarm_s"].isna().sum()),
                "named wrong (of all)": int(wrong.sum()),
                "alarm (s), median": round(float(moves["alarm_s"].median()), 2),
                "named (s), median": round(float(moves["named_s"].median()), 2),
                "departed": int(np.isfinite(own["departed_s"]).sum()),
                "kind right": int((right & (moves["kind_said"] == SAID[str(kind)])).sum()),
                "kind wrong": int((right & ~moves["kind_said"].isin(["", SAID[str(kind)]])).sum()),
                "C accuses a sensor": int((own["C_accuses"] != "").sum()),
            }
        )
    return pd.DataFrame(lines)


def in_short(rows: pd.DataFrame) -> str:
    """Return the table's sums."""
    moves, far = rows[rows["moved"] >= 1.0], rows[rows["moved"] >= 2.0]
    wrong = rows["named"].ne("") & (rows["named"] != rows["channel"])
    return (
        f"A sensor accused by C: {int((rows['C_accuses'] != '').sum())} of {len(rows)}. "
        f"Right name where it moves the aircraft: {int((moves['named'] == moves['channel']).sum())} of "
        f"{len(moves)}; where by twice as much: {int((far['named'] == far['channel']).sum())} of {len(far)}. "
        f"Wrong name: {int(wrong.sum())} of {len(rows)}. Alarms before the onset: {int(rows['early'].sum())}."
    )


def report(rows: pd.DataFrame, command: str, seed: int, both: dict[str, gb.Monitor]) -> str:
    """Return the report as Markdown."""
    surfaces, throttle, sensors, healthy, logs = (
        rows[rows["part"] == part] for part in (*ALL_PARTS.split(","), "logs")
    )
    texts = [f"# Surface faults, told from sensor faults\n\n`{command}`. Seeds from {seed} on.\n"]
    if len(logs):
        texts.append(f"## Logs\n\n{markdown(log_table(logs))}\n")
    if not both:
        return "\n".join(texts)
    noise = ", ".join(f"{name} {noise_of(both['surfaces'], name):.2f}" for name in both["surfaces"].suspects)
    texts.append(f"Gusts and sensors amount to, in deg of the surface or % of throttle: {noise}.\n")
    for title, own in (("Surfaces", surfaces), ("Throttle", throttle)):
        if len(own):
            texts.append(f"## {title}\n\n{markdown(surface_table(own))}\n\n{in_short(own)}\n")
    if len(sensors):
        lines = []
        for channel, own in sensors.groupby("channel", sort=False):
            lines.append(
                {
                    "sensor": channel,
                    "flights": len(own),
                    "C named it": int((own["C_accuses"] == channel).sum()),
                    "C named another": int(((own["C_accuses"] != channel) & (own["C_accuses"] != "")).sum()),
                    "C says the same beside": int(own["C_same"].astype(bool).sum()),
                    "surfaces alarm": int((own["said"] != "").sum()),
                    "a surface named (wrong)": int((own["named"] != "").sum()),
                }
            )
        texts.append(f"## Sensors\n\n{markdown(pd.DataFrame(lines))}\n")
    if len(healthy):
        lines = []
        for (loop, kind), own in healthy.groupby(["loop", "kind"], sort=False):
            lines.append(
                {
                    "loop": "closed" if loop else "open",
                    "gusts": kind,
                    "flights": len(own),
                    "hours watched": round(float(own["hours"].sum()), 2),
                    "greatest score over its threshold": round(float(own["peak"].max()), 2),
                    "alarms": int((own["said"].fillna("") != "")[own["hours"].notna()].sum()),
                    "not flown": int(own["hours"].isna().sum()),
                    "a surface named": int((own["named"].fillna("") != "").sum()),
                    "C accuses": int((own["C_accuses"].fillna("") != "").sum()),
                }
            )
        texts.append(f"## Healthy flight\n\n{markdown(pd.DataFrame(lines))}\n")
        texts.append(f"{healthy['hours'].sum():.1f} h watched in all.\n")
    return "\n".join(texts)


def main() -> None:
    """Fly, watch and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=10, help="of each kind and surface (default: 10)")
    parser.add_argument("--hours", type=float, default=20.0, help="of healthy flight (default: 20)")
    parser.add_argument("--seed", type=int, default=HELD_SEED, help=f"the first (default: {HELD_SEED})")
    parser.add_argument("--parts", default=ALL_PARTS, help="which, between commas")
    parser.add_argument("--quick", action="store_true", help="one flight of each kind, half an hour of healthy flight")
    parser.add_argument("--out", type=Path, default=Path("out/surface_faults"), help="where report.md and rows.csv go")
    asked = parser.parse_args()
    flights, hours = (1, 0.5) if asked.quick else (asked.flights, asked.hours)
    asked.out.mkdir(parents=True, exist_ok=True)
    both = {} if asked.parts == "logs" else monitors()  # a log is judged by itself
    parts = {
        "surfaces": lambda: surface_rows(both, flights, asked.seed),
        "throttle": lambda: surface_rows(both, THROTTLE_TIMES * flights, asked.seed + 2000, "throttle"),
        "healthy": lambda: healthy_rows(both, hours, asked.seed),
        "sensors": lambda: sensor_rows(both, max(flights // 5, 1), asked.seed),
        "logs": lambda: log_rows(max(flights // 10, 1), asked.seed + 5000),
    }
    made: list[dict[str, object]] = []
    for part in asked.parts.split(","):
        for row in parts[part]():
            made.append({"part": part} | row)
            if len(made) % KEPT == 0:  # what has been flown isn't lost if the machine is
                pd.DataFrame(made).to_csv(asked.out / "rows.csv", index=False)
    rows = pd.DataFrame(made)
    rows.to_csv(asked.out / "rows.csv", index=False)
    chosen = "" if asked.parts == ALL_PARTS else f"--parts {asked.parts} "
    command = f"python experiments/surface_faults.py {chosen}--flights {flights} --hours {hours:g} --seed {asked.seed}"
    text = report(rows, command, asked.seed, both)
    write_report(asked.out, text, asked)
    print(text)


if __name__ == "__main__":
    main()
