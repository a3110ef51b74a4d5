"""Surfaces over a whole log: a flight whose answer is known, its surfaces or its sensors broken."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine.commands import CommandsJudged, commands_judged
from gtmbench.engine.samples import Samples, flight_of
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, Record
from gtmbench.verdict.timeline import Claim, SensorSpan, Sizes, State
from tests.helpers.answering import STEP_S, answering
from tests.helpers.night import by_day

ONSET_S = 80.0
Broken = Callable[[FloatArray], FloatArray]
# as the engine says of gyros and angles before it asks for surfaces
CLEAR: list[Claim] = [
    (name, SensorSpan(start_s=0.0, end_s=1e3, state=State.CLEAR, sizes=Sizes(error=1.0, within_s=60.0)))
    for name in (*GYROS, "phi", "theta")
]


def from_onset(change: Broken) -> Broken:
    first = round(ONSET_S / STEP_S)
    return lambda values: np.concatenate([values[:first], change(values)[first:]])


def late(values: FloatArray) -> FloatArray:
    found = values.copy()
    for row in range(1, len(found)):
        found[row] = found[row - 1] + STEP_S / 0.3 * (values[row] - found[row - 1])
    return found


KINDS: dict[str, Broken] = {"jam": np.zeros_like, "scale_factor": lambda values: 0.5 * values, "lag": late}
BROKEN: dict[str, Broken] = {
    "is biased": lambda values: values + max(2.0 * float(values.std()), 0.1),
    "reads too little": lambda values: 0.5 * (values + values.mean()),
    "is stuck": lambda values: np.full_like(values, values[round(ONSET_S / STEP_S)]),
}


def judged(record: Record, claims: list[Claim], *left_out: str) -> CommandsJudged:
    samples = {name: Samples(record.time_s, record[name]) for name in record.channels if name not in left_out}
    said = commands_judged(flight_of(samples, is_driven=False), samples, claims, ())
    assert said is not None
    return said


@pytest.mark.parametrize("kind", by_day(KINDS))
@pytest.mark.parametrize("surface", by_day(["elevator", "aileron", "rudder"]))
def test_a_surface_is_named_with_its_kind_and_its_onset(surface: str, kind: str) -> None:
    said = judged(answering(surfaces={surface: from_onset(KINDS[kind])}), CLEAR)
    assert (said.named, said.kind) == (surface, kind)
    (failed,) = (span for _, span in said.claims if span.state is State.FAILED)
    assert failed.judgement is not None
    earliest_s, latest_s = failed.judgement.intervals["onset_s"]
    assert earliest_s <= ONSET_S <= latest_s
    assert latest_s - earliest_s < 20.0
    if kind == "scale_factor":
        assert failed.judgement.parameters["factor"] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("seed", by_day([10, 11]))
def test_a_healthy_flight_accuses_nobody(seed: int) -> None:
    said = judged(answering(seed=seed), [])
    assert said.named is None
    assert {span.state for _, span in said.claims} == {State.NOT_JUDGED}


@pytest.mark.parametrize(
    ("sensor", "how"),
    by_day([("p", "is stuck"), ("q", "reads too little"), ("alpha", "is biased"), ("ny", "is stuck")]),
)
def test_a_wrong_sensor_is_no_surface(sensor: str, how: str) -> None:
    record = answering()
    said = judged(record.replace(sensor, from_onset(BROKEN[how])(record[sensor])), [])
    assert said.named is None


def test_what_others_exclude_of_a_sensor_decides() -> None:
    """A pitch gyro that reads too little looks like an elevator that is stuck, unless the attitude says it is well."""
    record = answering(surfaces={"elevator": from_onset(np.zeros_like)})
    alone, beside = judged(record, []), judged(record, CLEAR)
    assert (alone.named, beside.named) == (None, "elevator")
    assert "q" in alone.doubt


def test_a_log_is_told_by_its_first_line(tmp_path: Path) -> None:
    stuck = gb.Jam(channel="aileron", onset_s=100.0)
    flight = gb.fly("gtm", "doublets+turbulence", 170.0, 1_010_001, faults=stuck)
    gb.write_log(gb.measure(flight, noise="t2", seed=1, commands=True), tmp_path / "flight.csv")
    watched = gb.watch_log(tmp_path / "flight.csv", "auto", judge="surfaces")
    (failed,) = watched.timeline.of("aileron", State.FAILED)
    assert failed.start_s == pytest.approx(100.0, abs=8.0)
    assert [alarm.sensor for alarm in watched.of_others] == ["aileron"]
    assert watched.outcome.name == "FAILED"
    assert {*watched.scope.sensors} == {"aileron", "elevator", "rudder"}


@pytest.mark.nightly
def test_a_log_of_which_surfaces_are_not_asked_says_nothing_of_them(tmp_path: Path) -> None:
    flight = gb.fly("gtm", "doublets+turbulence", 60.0, 1_010_001)
    gb.write_log(gb.measure(flight, noise="t2", seed=1, commands=True), tmp_path / "flight.csv")
    unasked = gb.watch_log(tmp_path / "flight.csv", "auto")
    assert (unasked.course.commands, unasked.of_others) == (None, ())
    assert "aileron" not in unasked.timeline.sensors
