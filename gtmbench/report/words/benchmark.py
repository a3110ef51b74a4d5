"""What the benchmark's page says: the one number, the rows, the data sheet, the citation."""

from __future__ import annotations

from typing import Any

from gtmbench.study.benchmark.definition import CALIBRATION, LEARN, PRIVATE, Definition, Group, secret_digest
from gtmbench.version import __version__

QUICKNESS = """\
**Quickness**, the one number: a fault that is detected d seconds after its onset, and by the limit of quickest
detection after L, counts log(60/d)/log(60/L), at most 1 (d and L at least 0.1 s); a missed one counts 0. Quickness is
the mean over all faults with L < 60 s, and a dash for who certainly raises more false alarms than are allowed."""

DIFFER = """\
*Spread*: lowest and highest quickness of ten calibrations whose flights are drawn anew, with replacement. Two rows
differ where their spreads don't overlap, and only then; *place* says which places a row may have. A table of alarms has
no calibration, so it has no spread. *Delay*: by when half of these faults are detected, a dash where fewer are.
*Times the limit*: median of delay over limit (each at least 0.1 s) where detected. False alarms: on healthy flights and
before an onset, with the exact 95 % interval. Cost: median CPU time, all channels of a sample; machines differ."""

ROWS = """\
Rows in italics aren't detectors. *limit*: alarms at the limit of quickest detection. *oracle*: knows the onset.
*random*: at the allowed rate, at random. *never*, *always* (an alarm a minute). *raw-reading*: a limit on readings."""


def about(definition: Definition, split: str) -> dict[str, Any]:
    """Return which flights rows were judged on."""
    flights = [flight for flight in definition.flights(split) if not flight.twin]
    return {
        "benchmark": definition.name,
        "digest": definition.digest,
        "split": split,
        "differs": definition.differing,
        "private_seed": secret_digest(definition) if split == PRIVATE else None,
        "gtmbench": __version__,
        "faults": sum(flight.fault is not None for flight in flights),
        "healthy_hours": _hours(definition, [flight.rows for flight in flights if flight.fault is None]),
        "false_alarms_per_hour": definition.false_alarms_per_hour,
        "deadline_s": definition.deadline_s,
    }


def _hours(definition: Definition, rows: list[int]) -> float:
    return round(len(rows) * definition.duration_s / 3600.0, 2)


def data_sheet(definition: Definition, split: str) -> str:
    """Return the data sheet: what there is, what it measures, what it doesn't, known artefacts."""
    facts = about(definition, split)
    lines = [_group_line(definition, group, split) for group in definition.groups]
    versions = ", ".join(f"{name} {version}" for name, version in definition.versions.items())
    onset = " to ".join(f"{each:g}" for each in definition.onset_s)
    here = f"This run differs: {facts['differs']}." if facts["differs"] else "This run has these versions."
    return f"""\
## Data sheet

**What there is.** Simulated flights of {definition.duration_s:g} s (JSBSim), {facts["healthy_hours"]:g} healthy hours
and {facts["faults"]} faults of one gyro or attitude sensor in split `{split}`:

{chr(10).join(lines)}

Channels: {", ".join(definition.channels)}.
One fault a flight, from {onset} s on, to its end. Splits `learn`, `calibration`, `development` and `test` have
published seeds; `private` follows from a secret whose digest is published first. Licence of the flights: CC0 1.0.

**What it measures.** How soon after its onset a lasting fault of one sensor is detected in open-loop flight, beside
what is possible; whom a detector names; whether its thresholds keep the rate that they are set for.

**What it doesn't.** Faults in the loop (an autopilot that flies on the broken gyro), several faults at once, faults
that end, an attitude that an estimator makes of the gyros, noise or aircraft that nobody calibrated for, real flights.

**Known artefacts.** The limit is to first order, so a lucky row may pass it on single faults. It knows what replaces a
reading and what draws random numbers to the last bit, so `jam`, `noise`, `spikes` and the like can't be reached. On a
chain of sensors it is that of ideal ones. It uses gyro and angle of one axis alone. Turbulence is JSBSim's Milspec
model. Who compares the bits of files finds the twins that are cut short; that is cheating, and not by accident.

**Bits.** They hold for {versions}, on CPUs with fused multiply-add; elsewhere flights agree to 1e-9. {here}"""


def _group_line(definition: Definition, group: Group, split: str) -> str:
    """Return what a group has, in a line."""
    counts = {of: sum(each.group == group for each in definition.flights(of)) for of in (LEARN, CALIBRATION)}
    judged = [each for each in definition.flights(split) if each.group == group and not each.twin]
    broken = sum(each.fault is not None for each in judged)
    lost = ", ".join(f"{each:.0%}" for each in dict.fromkeys(group.lost))
    return (
        f"- `{group.name}`: {group.aircraft}, {group.rate_hz:g} Hz, {group.sensors} sensors, noise "
        f"{', '.join(dict.fromkeys(group.noise))}, rows lost {lost}: {counts[LEARN]} flights to learn, "
        f"{counts[CALIBRATION]} to calibrate, {broken} with a fault, {len(judged) - broken} healthy"
    )


def citation(definition: Definition, split: str) -> str:
    """Return the CITATION.cff of the benchmark."""
    digest = secret_digest(definition) if split == PRIVATE else ""
    private = f'\nnotes: "private split, seed sha256 {digest}"' if digest else ""
    return f"""\
cff-version: 1.2.0
message: "If you use {definition.name}, cite this data set with its digest, and the version of gtmbench that judged."
title: "{definition.name}: {definition.title}"
type: dataset
version: "{definition.name}"
license: CC0-1.0
authors:
  - name: "the gtmbench authors"
identifiers:
  - type: other
    value: "sha256:{definition.digest}"
    description: "digest of the definition"{private}
references:
  - type: software
    title: "gtmbench: an open testbed for aircraft sensor faults"
    version: "{__version__}"
    authors:
      - name: "the gtmbench authors"
"""
