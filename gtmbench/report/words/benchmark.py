"""What the benchmark's page says: the one number, the rows, the data sheet, the citation."""

from __future__ import annotations

from typing import Any

from gtmbench.study.benchmark.definition import (
    ALIKE,
    CALIBRATION,
    COMMON,
    EASY,
    HEALTHY,
    LEARN,
    PAIR,
    PRIVATE,
    SINGLE,
    Definition,
    Group,
    secret_digest,
)
from gtmbench.version import __version__

QUICKNESS = """\
**Quickness**, the one number. Of a fault, d is the mean delay over its flights, r that of the reference and T how long
it could have been detected; a missed one counts with all of T. Quickness is the sum of log(T/d) over all faults over
that of log(T/r), d and r at least 0.1 s: 1 for the reference, 0 for who misses all, and a dash for who certainly raises
more false alarms than are allowed. In brackets: the 95 % interval, faults, flights and calibrations drawn anew."""

DIFFER = """\
Two rows differ where a paired test on the same draws says so (5 % for all pairs together); *place* says which places a
row may have. *Delay*: by when half of these flights are detected, a dash where fewer are. *Easy*: faults in the
converter that a repeated or round reading betrays. *Second*: second faults that are named. *Accused*: flights with one
cause in all gyros on which one sensor is named. *Look-alikes*: healthy flights with severe gusts, a gap and up to 0.5 s
of repeated rows, on which there is an alarm. False alarms: on all other healthy flights and before an onset, each again
after 10 s, with the 95 % interval. Cost: median CPU time, all channels of a sample; machines differ."""

ROWS = """\
Rows in italics aren't detectors. *reference*: a CUSUM that knows the fault, its shape and the noise. *oracle*: knows
the onset. *random*: at the allowed rate, at random. *never*, *always* (an alarm in ten seconds). *raw-reading*: a limit
on readings."""


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
        **{role: sum(flight.role == role for flight in flights) for role in (SINGLE, EASY, COMMON, PAIR, ALIKE)},
        "faults": len({(flight.group.name, flight.case) for flight in flights if flight.role == SINGLE}),
        "healthy_hours": round(sum(flight.role == HEALTHY for flight in flights) * definition.duration_s / 3600.0, 2),
        "false_alarms_per_hour": definition.false_alarms_per_hour,
        "deadline_s": definition.deadline_s,
    }


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
and {facts["faults"]} faults of one gyro or attitude sensor, each on {definition.repeats} flights, in split `{split}`;
beside them {facts["easy"]} flights with a fault in the converter, {facts["common"]} with one cause in all gyros,
{facts["pair"]} with two faults, {facts["alike"]} healthy ones that look like one with a fault.

{chr(10).join(lines)}

Channels: {", ".join(definition.channels)}.
Faults begin from {onset} s on. Kinds, sizes, frequencies, times and signs are drawn from the ranges of the definition,
readings have a converter's steps, healthy and broken alike. Every flight has noise of its own (level 0.6 to 1.3, a
quarter autoregressive, a quarter with heavy tails), turbulence from light to severe, surfaces of its own, and may lose
rows, or up to a second at once. All draws follow from a SHA-256 of 128 bits by name,
split and group: no two sets share a flight. `private` follows from a secret whose digest is published first.
Licence of the flights: CC0 1.0.

**What it measures.** The detection delay of a fault of one sensor in open-loop flight, beside a reference that knows
all but the onset; whom a detector names; whether its thresholds keep the rate that they are set for.

**What it doesn't.** Faults in the loop (an autopilot that flies on the broken gyro), an attitude that an estimator
makes of the gyros, aircraft that nobody calibrated for, real flights.

**Known artefacts.** The reference is optimal for constant changes in white noise, a reference only for all others. It
knows random numbers of a fault to the last bit. On a chain and where rows are missing it is that of ideal sensors, and
of heavy tails it makes no use. It uses gyro and angle of one axis alone. Turbulence is JSBSim's Milspec model, whose
seed has 31 bits: who flies 2^31 flights for it finds the motion of one private flight, but not its noise or fault. Who
compares the bits of files finds the twins that are cut short; that is cheating, and not by accident.

**Bits.** They hold for {versions}, on CPUs with fused multiply-add; elsewhere flights agree to 1e-9. {here}"""


def _group_line(definition: Definition, group: Group, split: str) -> str:
    """Return what a group has, in a line."""
    counts = {of: sum(each.group == group for each in definition.flights(of)) for of in (LEARN, CALIBRATION)}
    judged = [each for each in definition.flights(split) if each.group == group and not each.twin]
    broken = sum(bool(each.faults) for each in judged)
    return (
        f"- `{group.name}`: {group.aircraft}, {group.rate_hz:g} Hz, {group.sensors} sensors: {counts[LEARN]} flights "
        f"to learn, {counts[CALIBRATION]} to calibrate, {broken} with a fault, {len(judged) - broken} healthy"
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
