"""The engine of `gtmbench/engine`, held against recorded and simulated flights, as they are and with faults of gyros.

    python experiments/engine_on_logs.py [FOLDER ...] [--gtm N] [--faults N] [--half odd|even|all] [--seed N]
        [--jobs N] [--quick] [--out DIR]

Judges every log below the folders that opens, lasts more than a minute, moves and has accelerometers, and `--gtm`
simulated flights of the GTM, written as logs: as they are, each sensor on its own stamps, then with `--faults` drawn
faults, on the records that `open_log` makes of it. `--half` takes half of the groups of logs, by their names' CRC, so
that one can be kept unseen; a group is what stands before ``__`` in a file's name, else its folder. Prints tables;
writes report.md, logs.csv and faults.csv into DIR. Ends with code 1 where a target is missed (never with --quick).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.engine.finding import Finding
from gtmbench.engine.flight import Flight
from gtmbench.engine.judged import Judged, judged
from gtmbench.engine.samples import FORCES, Samples, flight_of
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_samples
from gtmbench.intake.other_sensors import other_sensors_of
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.jobs.processes import spread
from gtmbench.log.opening.driven_attitude import origin_in_logs
from gtmbench.method.driven_attitude import Origin
from gtmbench.report.markup import markdown
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import runs
from gtmbench.verdict.timeline import SensorSpan, State, Timeline, laid_out
from recorded.whole import broken_record
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

CHANNELS = (*GYROS, *ATTITUDE)
REAL, SIMULATED = "real", "simulated"
SHORTEST_S, MOVES_DEG_S, USUAL, IN_MOTION = 60.0, 3.0, 0.9, 0.2  # of a log: the quantile of its motion; a share of that
FLOWN_S = 120.0
BEFORE_S, LEFT_S, EARLY = 3.0, 20.0, 0.4  # before and behind an onset; of a log
DATED_S, GROWN_S, AT_ONCE_S = 15.0, 30.0, 2.0  # off the onset; that of a drift
NEAR_S, CLEAR_DEG_S = 60.0, 5.0
RIGHT, WRONG, EITHER_OR, CANT_TELL, NOTHING = "right", "wrong", "either-or", "can't tell", "nothing"
BIAS, DRIFT, SCALE, STUCK = "bias", "drift", "scale", "stuck"  # what findings call a fault

KINDS: dict[str, tuple[str, float]] = {  # its size; of a scale, its factor
    "bias 5 deg/s": (BIAS, 5.0),
    "bias 2 deg/s": (BIAS, 2.0),
    "bias 1 deg/s": (BIAS, 1.0),
    "drift 0.1 deg/s2": (DRIFT, 0.1),
    "drift 0.5 deg/s2": (DRIFT, 0.5),
    "scale 0.6": (SCALE, 0.6),
    "sign": (SCALE, -1.0),
    "jam": (STUCK, np.nan),
}
FOLLOWS = {
    "alone": None,
    "5 s": gb.AttitudeEstimator(time_constant_s=5.0),
    "Kalman": gb.AttitudeEstimator.kalman(gyro_noise=0.02, bias_walk=0.002, reference_noise=0.1),
}
SAID_QUICK = "**Quick: one flight, two faults. It shows that the script runs, and bounds nothing.**"
INTRODUCTION = """A fault is of a drawn kind, gyro and sign, begins evenly from 3 s after a log's start to 20 s before
its end, and lasts. *alone*: the attitude stays as it is. *5 s*, *Kalman*: it follows the gyro through an estimator of
that time constant, or one that learns the gyro's bias. A fault that would bend it beyond Euler angles isn't put.

- *right*: the broken gyro is named; *dated*, within 15 s of the onset, of a drift 30 s. *wrong*: another sensor is
  named that isn't without the fault. *either-or*: nobody is, and suspects that are dated have the broken gyro among
  them. *can't tell*: the gyro isn't clear at the onset. *nothing*: it is.
- *inside*: the broken log's timeline calls the gyro clear at the onset, up to a size that the fault has, and nobody
  failed or is suspected within a minute. *above*: the fault has the size that the healthy log's timeline states there.
  A drift has half of what it reaches in a minute; a jam has any.
- *in interval*: the size, where gyro and kind are right. *within 2 s*: the onset, where the gyro is right. *early*: in
  the first 40 % of a log. *clear*: the share of motion in which gyros are clear up to 5 deg/s. *CPU*: what the engine
  takes, without reading the log."""
Row = dict[str, Any]
Cell = Callable[[pd.DataFrame], object]


class Log(NamedTuple):
    """A file, where it comes from, and which faults are put on it."""

    path: Path
    flights: str
    faults: int
    seed: int

    @property
    def group(self) -> str:
        """Whose log it is."""
        whose, mark, _ = self.path.name.partition("__")
        return whose if mark else self.path.parent.name


class Put(NamedTuple):
    """A fault that is put on a log, and goes on for so long."""

    kind: str
    gyro: str
    attitude: str
    sign: float
    onset_s: float
    left_s: float

    @property
    def calls(self) -> str:
        """What a finding calls it."""
        return KINDS[self.kind][0]

    @property
    def size(self) -> float:
        """What a finding's size should be; NaN of a jam."""
        size = KINDS[self.kind][1]
        return 1.0 - 1.0 / size if self.calls == SCALE else self.sign * size

    @property
    def dated_s(self) -> float:
        """How far off an onset may be."""
        return GROWN_S if self.calls == DRIFT else DATED_S

    def off_s(self, finding: Finding) -> float:
        """Return by how much a finding's onset is off."""
        return abs(finding.onset_s - self.onset_s)

    def fault(self) -> gb.Fault:
        """Return the fault itself."""
        if self.calls == STUCK:
            return gb.Jam(channel=self.gyro, onset_s=self.onset_s)
        if self.calls == SCALE:
            return gb.ScaleFactor(channel=self.gyro, onset_s=self.onset_s, factor=KINDS[self.kind][1])
        if self.calls == DRIFT:
            return gb.Drift(channel=self.gyro, onset_s=self.onset_s, slope=self.size)
        return gb.Bias(channel=self.gyro, onset_s=self.onset_s, size=self.size)

    def is_promised(self, span: SensorSpan) -> bool:
        """Tell whether a span is clear up to a size that it has."""
        sizes = span.sizes
        if span.state is not State.CLEAR or sizes is None:
            return False
        if self.calls == SCALE:
            return sizes.factors is not None and KINDS[self.kind][1] <= sizes.factors[0]
        grows_s = 0.5 * min(self.left_s, NEAR_S) if self.calls == DRIFT else 1.0
        return self.calls == STUCK or abs(self.size) * grows_s >= sizes.error


# ---- logs ----


class Opened(NamedTuple):
    """A log that has gyros and an attitude, sample by sample, and whether the gyros drive that."""

    read: ReadLog
    sensors: Mapping[str, Samples]
    origin: Origin

    def flight(self, records: Sequence[gb.Record] = ()) -> Flight:
        """Return the flight of its own samples, or with gyros and attitude of some records."""
        own = dict(self.sensors)
        if records:
            time_s = np.concatenate([record.time_s for record in records])
            own |= {name: Samples(time_s, np.concatenate([each[name] for each in records])) for name in CHANNELS}
        return flight_of(own, is_driven=self.origin.is_driven, is_assumed=self.origin.is_assumed)


def opened(path: Path) -> Opened:
    """Open a log; raise InputError of one that lacks gyros or attitude."""
    read = read_log(path)
    sensors = {name: Samples(each.time_s, each.values) for name, each in log_samples(read, CHANNELS).items()}
    accelerometers = [each for each in other_sensors_of(read) if set(FORCES) <= set(each.channels)]
    for each in accelerometers[:1]:
        forces = zip(each.channels, np.transpose(each.values), strict=True)
        sensors |= {name: Samples(each.time_s, values) for name, values in forces}
    return Opened(read, sensors, origin_in_logs([read]))


def left_out(log: Log) -> str:
    """Return why a log isn't judged; "" of one that is."""
    try:
        flight = opened(log.path).flight()
    except InputError:
        return "without gyros and attitude"
    if len(flight) * flight.blocks.period_s <= SHORTEST_S:
        return "too short"
    if np.quantile(flight.lively, USUAL) <= MOVES_DEG_S:
        return "without motion"
    return "without accelerometers" if flight.forces is None else ""


def halved(logs: Sequence[Log], half: str) -> list[Log]:
    """Return the logs of half of the groups, or all of them; a group's half is its own, whatever others there are."""
    remainders = {"even": (0,), "odd": (1,), "all": (0, 1)}[half]
    return [log for log in logs if zlib.crc32(log.group.encode()) % 2 in remainders]


def flown(folder: Path, flights: int, seed: int) -> Iterator[Path]:
    """Write simulated flights as logs, and give their paths."""
    for number in range(1000 * seed, 1000 * seed + flights):
        truth = gb.fly("gtm", "multisine+turbulence", FLOWN_S, seed=number)
        path = folder / f"gtm {number}.csv"
        gb.write_log(gb.measure(truth, noise="t2", seed=number).select([*CHANNELS, *FORCES]), path)
        yield path


# ---- rows ----


def judge(log: Log) -> tuple[Row, list[Row]]:
    """Return the row of a log as it is, and one each fault."""
    whose = {"flights": log.flights, "group": log.group, "log": log.path.name}
    own, began = opened(log.path), time.process_time()
    said = judged(own.flight())
    row = {**whose, "cpu_s": time.process_time() - began, **of_healthy(said)}
    try:
        records = gb.open_log(own.read, needs=CHANNELS).segments if log.faults else ()
    except InputError:
        records = ()
    if not records:
        return row, []
    before, faults = judged(own.flight(records)), []
    for put in drawn(log, records):
        try:
            changed = [broken(each, put) for each in records]
        except InputError:  # it would bend the attitude beyond Euler angles
            continue
        faults.append({**whose, **of_fault(put, judged(own.flight(changed)), before)})
    return row, faults


def drawn(log: Log, records: Sequence[gb.Record]) -> Iterator[Put]:
    """Draw faults of a log by its name, whatever other logs there are."""
    random = np.random.default_rng([log.seed, zlib.crc32(log.path.name.encode())])
    start_s, end_s = records[0].start_s, records[-1].end_s
    for _ in range(log.faults):
        kind, gyro, attitude = (str(random.choice(list(names))) for names in (KINDS, GYROS, FOLLOWS))
        onset_s, sign = random.uniform(start_s + BEFORE_S, end_s - LEFT_S), random.choice([-1.0, 1.0])
        yield Put(kind, gyro, attitude, float(sign), onset_s, end_s - onset_s)


def broken(record: gb.Record, put: Put) -> gb.Record:
    """Return a stretch with a fault from its onset on."""
    return broken_record(record, put.fault(), FOLLOWS[put.attitude])


def timeline_of(said: Judged) -> Timeline:
    """Return the timeline of what is said, and where the aircraft moves."""
    lively, blocks = said.flight.lively, said.flight.blocks
    edges_s = blocks.start_s + blocks.period_s * np.arange(len(lively) + 1)
    motion = runs(lively > IN_MOTION * np.quantile(lively, USUAL))
    motion_s = [(float(edges_s[first]), float(edges_s[last])) for first, last in zip(*motion, strict=True)]
    return laid_out((float(edges_s[0]), float(edges_s[-1])), said.claims, motion_s=motion_s)


def of_healthy(said: Judged) -> Row:
    """Return how much of a log's motion is clear, and who is accused."""
    timeline = timeline_of(said)
    row: Row = {"minutes": (timeline.span_s[1] - timeline.span_s[0]) / 60.0, "motion_s": timeline.motion_total_s}
    for gyro in GYROS:
        clear = [span for span in timeline.of(gyro, State.CLEAR) if span.sizes and span.sizes.error <= CLEAR_DEG_S]
        row[f"{gyro} clear"] = sum(map(timeline.moving_s, clear)) / timeline.motion_total_s
    return row | {"named": " ".join(each.named for each in said.found if each.named), "found": in_words(said.found)}


def of_fault(put: Put, said: Judged, before: Judged) -> Row:
    """Return what is said of a log with a fault."""
    timeline = timeline_of(said)
    here, stated = (each.at(put.gyro, put.onset_s) for each in (timeline, timeline_of(before)))
    right = sorted((each for each in said.found if each.named == put.gyro), key=put.off_s)
    wrong = {each.named for each in said.found if each.named} - {put.gyro, *(each.named for each in before.found)}
    late_s = right[0].onset_s - put.onset_s if right else np.nan
    share = (put.onset_s - timeline.span_s[0]) / (timeline.span_s[1] - timeline.span_s[0])
    return {
        **put._asdict(),
        "when": "early" if share < EARLY else "later",
        "stated": stated.sizes.error if stated.sizes else np.nan,
        "above": put.is_promised(stated),
        "said": WRONG if wrong else RIGHT if right else unnamed(put, said, is_clear=here.state is State.CLEAR),
        "right": bool(right),
        "wrong": " ".join(sorted(map(str, wrong))),
        "late_s": late_s,
        "dated": abs(late_s) <= put.dated_s,
        "at once": abs(late_s) <= AT_ONCE_S,
        "in interval": in_interval(put, right[0]) if right else np.nan,
        "inside": put.is_promised(here) and not is_accused(timeline, put.onset_s),
        "found": in_words(said.found),
    }


def unnamed(put: Put, said: Judged, *, is_clear: bool) -> str:
    """Return what is said of a fault where nobody is named."""
    among = [each for each in said.found if put.gyro in each.suspects and not (each.doubt or each.is_healthy)]
    if any(put.off_s(each) <= put.dated_s for each in among):
        return EITHER_OR
    return NOTHING if is_clear else CANT_TELL


def is_accused(timeline: Timeline, onset_s: float) -> bool:
    """Tell whether any sensor failed or is suspected within a minute of an onset."""
    accused = [span for sensor in CHANNELS for span in timeline.of(sensor, State.FAILED, State.SUSPECTED)]
    return any(span.start_s < onset_s + NEAR_S and span.end_s > onset_s for span in accused)


def in_interval(put: Put, finding: Finding) -> float:
    """Return 1 where a size lies in a finding's interval, and 0 where not; NaN where they can't be compared."""
    if put.calls == STUCK or finding.best.kind != put.calls:
        return np.nan
    return float(finding.interval[0] <= put.size <= finding.interval[1])


def in_words(found: Sequence[Finding]) -> str:
    """Return what was found: suspects, kind and size, when, the broken side, and why nobody is named."""
    return "; ".join(
        f"{' or '.join(each.suspects)} {each.best.kind} {each.size:.2g}, {each.onset_s:.0f} to {each.end_s:.0f} s, "
        f"{each.side}" + (f" ({each.doubt})" if each.doubt else "")
        for each in found
    )


# ---- tables ----


def share(rows: pd.DataFrame, *columns: str) -> float:
    """Return the share of rows in which everything holds; NaN of none."""
    return float(rows[list(columns)].all(axis=1).mean()) if len(rows) else np.nan


def clear_share(logs: pd.DataFrame, gyros: Sequence[str] = GYROS) -> float:
    """Return the share of all motion in which gyros are clear."""
    clear = logs[[f"{gyro} clear" for gyro in gyros]].mean(axis=1)
    return float((clear * logs["motion_s"]).sum() / logs["motion_s"].sum())


def percent(value: float) -> str:
    """Write a share; a dash where there is none."""
    return "-" if np.isnan(value) else f"{100.0 * value:.0f}"


def cleared(gyro: str) -> Cell:
    """Return what writes the share of motion in which a gyro is clear."""
    return lambda of: percent(clear_share(of, [gyro]))


def counted(column: str, value: object = True) -> Cell:
    """Return what counts the rows with a value."""
    return lambda of: int((of[column] == value).sum())


OF_LOGS: dict[str, Cell] = {
    "logs": len,
    "groups": lambda of: of["group"].nunique(),
    "minutes": lambda of: f"{of['minutes'].sum():.0f}",
    "accused": lambda of: share_text(int((of["named"] != "").sum()), len(of)),
    **{f"{gyro} clear (%)": cleared(gyro) for gyro in GYROS},
}
OF_FAULTS: dict[str, Cell] = {
    "faults": len,
    **{said: counted("said", said) for said in (RIGHT, EITHER_OR, CANT_TELL, NOTHING, WRONG)},
    "inside": counted("inside"),
    "right, dated (%)": lambda of: percent(share(of, "right", "dated")),
    "above": counted("above"),
    "of these right, dated (%)": lambda of: percent(share(of[of["above"]], "right", "dated")),
    "in interval (%)": lambda of: percent(of["in interval"].mean()),
    "within 2 s (%)": lambda of: percent(share(of[of["right"]], "at once")),
}
OF_BAD = ("log", "kind", "gyro", "attitude", "sign", "onset_s", "stated", "wrong", "inside", "found")
TARGETS = (  # the figure, its bound for real flights and for simulated ones
    ("healthy logs accused", "accused", "<=", 0.0, 0.0),
    ("motion in which gyros are clear up to 5 deg/s, share", "clear", ">=", 0.65, 0.95),
    ("CPU, seconds a minute of log", "cpu", "<=", 0.5, 0.5),
    ("faults above the promise, right and dated, share", "right", ">=", 0.6, 0.6),
    ("the same of later onsets, less that of the first 40 %", "early", "<=", 0.05, 0.05),
    ("faults of which a healthy sensor is named, share", "wrong", "<=", 0.005, 0.005),
    ("faults inside", "inside", "<=", 0.0, 0.0),
    ("sizes in their interval, share", "interval", ">=", 0.9, 0.9),
    ("onsets within 2 s, share", "onset", ">=", 0.6, 0.9),
)


def figures_of(logs: pd.DataFrame, faults: pd.DataFrame) -> dict[str, float]:
    """Return the figures that the targets are of."""
    figures = {
        "accused": float((logs["named"] != "").sum()),
        "clear": clear_share(logs),
        "cpu": float(logs["cpu_s"].sum() / logs["minutes"].sum()),
    }
    if not len(faults):
        return figures
    above = faults[faults["above"]]
    early, later = (share(above[above["when"] == when], "right", "dated") for when in ("early", "later"))
    return figures | {
        "right": share(above, "right", "dated"),
        "early": later - early,
        "wrong": float((faults["wrong"] != "").mean()),
        "inside": float(faults["inside"].sum()),
        "interval": float(faults["in interval"].mean()),
        "onset": share(faults[faults["right"]], "at once"),
    }


def report(logs: pd.DataFrame, faults: pd.DataFrame, reasons: Sequence[str]) -> tuple[list[str], bool]:
    """Return the parts of a report, and whether a target is missed."""
    parts = {of: faults[faults["flights"] == of] if len(faults) else faults for of in logs["flights"].unique()}
    figures = {of: figures_of(logs[logs["flights"] == of], own) for of, own in parts.items()}
    targets = [
        Target(f"{of}: {text}", of, which, sense, real if of == REAL else simulated)
        for of, own in figures.items()
        for text, which, sense, real, simulated in TARGETS
        if which in own
    ]
    text = [markdown(held(targets, figures)), markdown(grouped(logs, {"flights": "flights"}, OF_LOGS))]
    if counts := Counter(filter(None, reasons)):
        text.append("Left out: " + ", ".join(f"{count} {why}" for why, count in counts.items()) + ".")
    if len(faults):
        for by in (["flights"], ["flights", "kind"], ["flights", "attitude"], ["flights", "when"]):
            in_order = faults.sort_values(by, kind="stable")
            text.append(markdown(grouped(in_order, {name: name for name in by}, OF_FAULTS)))
    text += ["## Healthy logs that are accused", rows_text(logs[logs["named"] != ""], ["log", "named", "found"])]
    if len(faults):
        bad = faults[(faults["wrong"] != "") | faults["inside"]]
        text += ["## Faults of which a healthy sensor is named, or inside", rows_text(bad, OF_BAD)]
    return text, is_missed(targets, figures)


def rows_text(rows: pd.DataFrame, columns: Sequence[str]) -> str:
    """Return a table of rows; a word where there is none."""
    return markdown(rows[[*columns]].round(1)) if len(rows) else "None."


# ---- all of it ----


def conduct(campaign: Campaign) -> Findings:
    """Find logs, fly, judge, report."""
    given = campaign.given
    flights, faults = (1, 2) if campaign.quick else (given.gtm, given.faults)
    wrong = [f"{folder} is no folder" for folder in given.folders if not folder.is_dir()]
    if wrong or not (given.folders or flights):
        raise InputError(f"{', '.join(wrong) or 'nothing is given'}; give folders of logs, --gtm, or both")
    paths = [path for folder in given.folders for path in sorted(folder.rglob("*")) if path.is_file()]
    files = [Log(path, REAL, faults, given.seed) for path in paths]
    reasons = spread(left_out, files, processes=campaign.jobs, step="files", progress=campaign.tell)
    todo = halved([log for log, why in zip(files, reasons, strict=True) if not why], given.half)
    with tempfile.TemporaryDirectory() as folder:
        todo += [Log(path, SIMULATED, faults, given.seed) for path in flown(Path(folder), flights, given.seed)]
        if not todo:
            raise InputError(f"none of {len(files)} files is a log that can be judged")
        done = spread(judge, todo, processes=campaign.jobs, step="logs", progress=campaign.tell)
    logs, put = pd.DataFrame([row for row, _ in done]), pd.DataFrame([row for _, rows in done for row in rows])
    text, missed = report(logs, put, reasons)
    head = ["# The engine on logs", *([SAID_QUICK] if campaign.quick else []), INTRODUCTION]

    def write(out: Path) -> None:
        logs.to_csv(out / "logs.csv", index=False)
        put.to_csv(out / "faults.csv", index=False)

    return Findings("\n\n".join([*head, *text]) + "\n", missed, write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is judged."""
    parser.add_argument("folders", nargs="*", type=Path, help="folders of logs")
    parser.add_argument("--gtm", type=int, default=0, help="simulated flights, too (default: %(default)s)")
    parser.add_argument("--faults", type=int, default=5, help="put on each log (default: %(default)s)")
    parser.add_argument("--half", choices=("even", "odd", "all"), default="all", help="half of the groups of logs")
    parser.add_argument("--seed", type=int, default=65, help="of all draws (default: %(default)s)")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one flight, two faults", arguments=arguments))
