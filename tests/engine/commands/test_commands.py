"""Surfaces over a whole log: a flight whose answer is known, its surfaces or its sensors broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.answering import STEP_S, answering

import gtmbench as gb
from gtmbench.engine.commands.commanded import commanded_of
from gtmbench.engine.commands.evidence import change_of, divided
from gtmbench.engine.commands.judged import CommandsJudged, commands_judged
from gtmbench.engine.commands.suspects import suspects_of
from gtmbench.engine.samples import Samples, flight_of
from gtmbench.values.record import FloatArray, Record
from gtmbench.verdict.timeline import SensorSpan, Sizes, State

ONSET_S = 80.0
Broken = Callable[[FloatArray], FloatArray]


def from_onset(change: Broken) -> Broken:
    first = round(ONSET_S / STEP_S)
    return lambda values: np.concatenate([values[:first], change(values)[first:]])


def late(values: FloatArray) -> FloatArray:
    found = values.copy()
    for row in range(1, len(found)):
        found[row] = found[row - 1] + STEP_S / 0.3 * (values[row] - found[row - 1])
    return found


KINDS: dict[str, Broken] = {
    "jam": np.zeros_like,
    "scale_factor": lambda values: 0.5 * values,
    "bias": lambda values: values + 1.0,
    "lag": late,
}
SENSORS: dict[str, dict[str, Broken]] = {
    name: {
        "is biased": lambda values, size=size: values + size,
        "reads too little": lambda values: 0.5 * (values + values.mean()),
        "is stuck": lambda values: np.full_like(values, values[round(ONSET_S / STEP_S)]),
    }
    for name, size in (("p", 5.0), ("q", 5.0), ("alpha", 2.0), ("beta", 2.0), ("ny", 0.1), ("nz", 0.2))
}


def samples_of(record: Record) -> dict[str, Samples]:
    return {name: Samples(record.time_s, record[name]) for name in record.channels}


def judged(record: Record, *claims: tuple[str, SensorSpan]) -> CommandsJudged:
    samples = samples_of(record)
    said = commands_judged(flight_of(samples, is_driven=False), samples, claims, ())
    assert said is not None
    return said


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("surface", ["elevator", "aileron", "rudder"])
def test_a_surface_is_named_with_its_kind_and_its_onset(surface: str, kind: str) -> None:
    said = judged(answering(surfaces={surface: from_onset(KINDS[kind])}))
    assert (said.named, said.kind) == (surface, kind)
    (failed,) = (span for name, span in said.claims if span.state is State.FAILED)
    assert failed.judgement is not None
    earliest_s, latest_s = failed.judgement.intervals["onset_s"]
    assert earliest_s <= ONSET_S <= latest_s
    assert failed.start_s == pytest.approx(ONSET_S, abs=4.0)
    sizes = {"scale_factor": ("factor", 0.5), "bias": ("size", 1.0)}
    for name, size in (sizes[kind],) if kind in sizes else ():
        assert failed.judgement.parameters[name] == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_a_healthy_flight_accuses_nobody(seed: int) -> None:
    said = judged(answering(seed=10 + seed))
    assert said.named is None
    assert {span.state for _, span in said.claims} == {State.NOT_JUDGED}


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("how", ["is biased", "reads too little", "is stuck"])
def test_a_wrong_sensor_is_no_surface(sensor: str, how: str) -> None:
    record = answering()
    broken = from_onset(SENSORS[sensor][how])(record[sensor])
    said = judged(record.replace(sensor, broken))
    assert said.named is None

