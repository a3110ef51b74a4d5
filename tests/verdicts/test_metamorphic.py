"""What has to hold between verdicts, whatever they are: nobody has to know the right one. Draws are seeded.

A handful runs in `make test`, the rest in `make verdicts`.
"""

import os
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.log.judging import certificate
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import State, Timeline
from tests.helpers.night import by_day
from tests.verdicts.entries import Entry, Watching, entry
from tests.verdicts.log_files import MIRRORED
from tests.verdicts.recipes import made
from tests.verdicts.requirements import false_all_clears, on_the_clock, reached_s, watched, wrong_names

SEED = int(os.environ.get("GTMBENCH_ORACLES", "64000"))  # `make nightly` gives another one
MARGIN = 1.5  # issue 64: at the stated size 5 % may be missed, from 1.5 times on none
MISSED = 0.05
TOLERANCE_S = 1.0
SAME_SIZE = 0.1  # as a share
FIRST_ONSET_S, LAST_ONSET_S = 10.0, 20.0  # after the log's first sample, before its last


@pytest.fixture(autouse=True)
def _whole_by_night(request):
    """By night logs are certified as they are for users: at as many onsets."""
    if request.node.get_closest_marker("nightly"):
        request.getfixturevalue("whole_certificates")


def seen(entry, folder):
    """Return the log of an entry, and its timeline."""
    log = made(entry, folder)
    return log, watched(entry, log).timeline


@cache
def base_of(name, onsets):
    """Return the timeline of an entry as it stands, certified at so many onsets."""
    assert onsets == certificate.ONSETS
    with TemporaryDirectory() as folder:
        return seen(entry(name), Path(folder))[1]


def between(random, low, high, digits=1):
    """Draw a number that is easy to read."""
    return round(float(random.uniform(low, high)), digits)


def drawn(kind, sensor, onset_s, sizes, share):
    """Return a fault of a share of the stated sizes; None where they say nothing of its kind."""
    common = {"channel": sensor, "onset_s": onset_s}
    low, high = sizes.factors or (None, None)
    return {
        "bias": lambda: gb.Bias(size=share * sizes.error, **common),
        "drift": lambda: gb.Drift(slope=share * sizes.error / 15.0, **common),
        "noise": lambda: sizes.noise and gb.Noise(deviation=share * sizes.noise, seed=1, **common),
        "less": lambda: low and gb.ScaleFactor(factor=1.0 + share * (low - 1.0), **common),
        "more": lambda: high and gb.ScaleFactor(factor=1.0 + share * (high - 1.0), **common),
        "sign": lambda: gb.SignFlip(**common),
        "stuck": lambda: gb.Jam(**common),
    }[kind]()


KINDS = ("bias", "drift", "noise", "less", "more", "sign", "stuck")
MOVED = ("healthy", "healthy-C", "healthy-identified", "healthy-ready", "healthy-60-beside-20-hz", "healthy-10-hz")


@dataclass(frozen=True)
class Move:
    """One fault that is moved through a log."""

    log: str
    kind: str
    sensor: str
    share: float
    onsets_s: tuple

    def __str__(self):
        return f"{self.log}-{self.kind}-{self.sensor}-{self.onsets_s[0]:.0f}"


def moves(number, seed, steps):
    """Draw faults, each of 1.6 to 4 times the stated size, and the onsets that it is moved to."""
    random = np.random.default_rng([SEED, seed])
    for place in range(number):
        log = MOVED[place % len(MOVED)]
        last_s = entry(log).duration_s - LAST_ONSET_S
        first_s = FIRST_ONSET_S + random.uniform(0.0, 15.0)
        onsets = np.linspace(first_s, last_s - random.uniform(0.0, 15.0), steps).round(1)
        sensor = random.choice(GYROS) if place % 4 else random.choice(ATTITUDE)
        kinds = KINDS if sensor in GYROS else ("bias", "drift", "stuck")
        yield Move(log, str(random.choice(kinds)), str(sensor), random.uniform(1.6, 4.0), tuple(map(float, onsets)))


def worst(timeline, sensor):
    """Return the worst sizes of a sensor's clear spans, each by itself; None where it has none."""
    clear = [span.sizes for span in timeline.of(sensor, State.CLEAR) if span.sizes]
    if not clear:
        return None
    factors, noises = [each.factors for each in clear], [each.noise for each in clear]
    return replace(
        max(clear, key=lambda each: each.error),
        factors=None if None in factors else (min(low for low, _ in factors), max(high for _, high in factors)),
        noise=None if None in noises else max(noises),
    )


def assert_no_false_all_clear(entry, folder):
    log, timeline = seen(entry, folder)
    faults, end_s = on_the_clock(entry), entry.clock_s + log.last_s
    found = [*false_all_clears(timeline, faults, end_s, margin=MARGIN), *wrong_names(timeline, faults, end_s)]
    assert "\n".join(map(str, found)) == ""


@pytest.mark.parametrize("move", by_day([*moves(2, seed=1, steps=2), *moves(24, seed=2, steps=5)]), ids=str)
def test_a_fault_moved_through_a_log_is_never_in_a_span_called_clear_for_its_size(move, tmp_path):
    base = entry(move.log)
    sizes = worst(base_of(move.log, certificate.ONSETS), move.sensor)
    if sizes is None:
        return
    for onset_s in move.onsets_s:
        fault = drawn(move.kind, move.sensor, onset_s, sizes, move.share)
        if fault:
            assert_no_false_all_clear(replace(base.with_faults(fault), name=f"{base.name}-{onset_s:g}"), tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["healthy", "healthy-C", "healthy-identified"])
def test_at_its_stated_size_a_fault_is_missed_from_few_onsets(name, tmp_path):
    """Faults of one to 1.5 times the size that is stated, where that is the size of the broken log's own timeline."""
    base, random = entry(name), np.random.default_rng([SEED, 3])
    healthy = base_of(name, certificate.ONSETS)
    missed, covered = [], 0
    for number in range(40):
        sensor, kind = str(random.choice(GYROS)), str(random.choice(["bias", "drift", "noise", "less", "more"]))
        onset_s = between(random, FIRST_ONSET_S, base.duration_s - LAST_ONSET_S)
        fault = drawn(kind, sensor, onset_s, worst(healthy, sensor), random.uniform(1.05, MARGIN))
        if not fault:
            continue
        broken = replace(base.with_faults(fault), name=f"{name}-{number}")
        log, timeline = seen(broken, tmp_path)
        covered += any(
            np.isfinite(reached_s(broken.faults[0], each.sizes)) for each in timeline.of(sensor, State.CLEAR)
        )
        missed += false_all_clears(timeline, broken.faults, log.last_s)
    assert len(missed) <= max(1.0, MISSED * covered), "\n".join(map(str, missed))


# ---- less information, or later


@dataclass(frozen=True)
class Loss:
    """A broken log, and what is lost of it."""

    log: str
    lost: str
    step: dict

    def __str__(self):
        return f"{self.log}-{self.lost}"


BROKEN = ("bias", "bias-C", "stuck", "learning-auto-bias", "learning-stuck", "second-fault-auto", "sign", "drift")


def losses(number, seed):
    """Draw what is lost of which log; the broken sensor is still there."""
    random = np.random.default_rng([SEED, seed])
    for place in range(number):
        base = entry(BROKEN[place % len(BROKEN)])
        broken = {each.fault.channel for each in base.faults}
        start_s = between(random, 15.0, base.duration_s - 40.0)
        beside = [name for name in base.channels if name not in broken]
        steps = {
            "gap": {"from_s": start_s, "to_s": start_s + between(random, 3.0, 20.0)},
            "rate_falls": {"from_s": float(random.choice([0.0, start_s])), "every": int(random.integers(2, 5))},
            "rounded": {"columns": list(base.channels), "step": float(random.choice([0.05, 0.2, 0.5]))},
            "late": {"columns": list(ATTITUDE), "by_s": between(random, 0.02, 0.2, digits=3)},
            "drop": {"columns": [str(random.choice(beside))]},
            "held": {"columns": list(ATTITUDE), "every": int(random.integers(2, 6))},
        }
        lost = list(steps)[int(random.integers(len(steps)))]
        yield Loss(base.name, lost, {"do": lost, **steps[lost]})


@pytest.mark.parametrize("loss", by_day([*losses(2, seed=4), *losses(48, seed=5)]), ids=str)
def test_less_information_never_clears_a_fault(loss, tmp_path):
    """Where the log can be watched at all."""
    base = entry(loss.log)
    less = replace(base, name=f"{base.name}-{loss.lost}", done=(*base.done, loss.step))
    try:
        assert_no_false_all_clear(less, tmp_path)
    except gb.InputError:
        return  # too little is left to watch, and that is said


# ---- the same log in other words

REWRITTEN = {
    "radians": {"file": "radians"},
    "mirrored": {"file": "mirrored"},
    "shifted": {"clock_s": 1000.0},
    "two-tables": {"file": "two_tables"},
}
RETOLD = ("bias", "fault-that-ends-alone", "healthy-identified", "gap", "stuck-p-C", "learning-identify-bias")


def rewritten(base, how):
    """Return an entry whose log says the same in another way."""
    changed = replace(base, name=f"{base.name}-{how}", **REWRITTEN[how])
    return replace(changed, watch=replace(base.watch, mapping=MIRRORED)) if how == "mirrored" else changed


def outline(timeline: Timeline, clock_s: float, sensor: str):
    """Return the states of a sensor in time, each with its beginning, without slivers."""
    states = []
    for span in timeline.sensors[sensor]:
        if span.duration_s > TOLERANCE_S and (not states or states[-1][0] is not span.state):
            states.append((span.state, span.start_s - clock_s))
    return states


def differences(one: Timeline, other: Timeline, clock_s: float):
    """Give how another timeline differs, whose log's clock is ahead."""
    for sensor in (*GYROS, *ATTITUDE):
        states, others = outline(one, 0.0, sensor), outline(other, clock_s, sensor)
        if [state for state, _ in states] != [state for state, _ in others]:
            yield f"{sensor}: {states} became {others}"
        elif any(abs(start - begun) > TOLERANCE_S for (_, start), (_, begun) in zip(states, others, strict=True)):
            yield f"{sensor}: {states} moved to {others}"
        before, after = worst(one, sensor), worst(other, sensor)
        if before and after and abs(after.error / before.error - 1.0) > SAME_SIZE:
            yield f"{sensor}: its size {before.error:.3g} became {after.error:.3g}"


SAID_ANEW = [("learning-identify-bias", "mirrored"), *((name, how) for name in RETOLD for how in REWRITTEN)]


@pytest.mark.parametrize(("name", "how"), by_day(dict.fromkeys(SAID_ANEW)))
def test_the_same_log_in_other_words_has_the_same_timeline(name, how, tmp_path):
    base: Entry = entry(name)
    changed = rewritten(base, how)
    one, (_, other) = base_of(name, certificate.ONSETS), seen(changed, tmp_path)
    assert list(differences(one, other, changed.clock_s)) == []


def test_axes_that_change_places_change_names():
    """The entries' variants by axis are what they say: the fault, and what is required of it, move together."""
    one, other = entry("while-learning"), entry("while-learning-q")
    assert [each.fault.channel for each in (*one.faults, *other.faults)] == ["p", "q"]
    assert [each.sensor for each in (*one.require, *other.require)] == ["p", "q"]
    assert isinstance(one.watch, Watching)
