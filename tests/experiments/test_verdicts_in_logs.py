"""The study of the default verdict on logs: what it makes of a timeline in which one sensor is broken."""

from types import SimpleNamespace

import pytest

import verdicts_in_logs as study
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, laid_out

END_S, ONSET_S = 100.0, 40.0


def timeline(clear=(), failed=(), suspected=()):
    """Return a timeline in which some sensors are clear up to 2 units, or are accused from the onset on."""
    sizes = Sizes(error=2.0, within_s=60.0, factors=(0.6, 1.5), noise=4.0)
    claims = {name: [SensorSpan(start_s=0.0, end_s=END_S, state=State.CLEAR, sizes=sizes)] for name in clear}
    for name in failed:
        claims[name] = [SensorSpan(start_s=ONSET_S, end_s=END_S, state=State.FAILED)]
    for name in suspected:
        suspects = tuple(suspected)
        claims[name] = [SensorSpan(start_s=ONSET_S, end_s=END_S, state=State.SUSPECTED, suspects=suspects)]
    return laid_out((0.0, END_S), claims)


def put(sensor="q", kind="bias", size=5.0, part="gyro"):
    return study.Put(part, sensor, kind, size, ONSET_S, SimpleNamespace())


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({}, study.NOTHING),
        ({"failed": ["q"]}, study.NAMED),
        ({"suspected": ["q", "theta"]}, study.EITHER),
        ({"suspected": ["p", "phi"]}, study.WRONG),
        ({"failed": ["q", "r"]}, study.WRONG),
        ({"failed": ["q"], "suspected": ["p", "phi"]}, study.WRONG),
    ],
)
def test_who_is_accused_is_held_against_who_is_broken(told, said):
    assert study.said_of(put(), "q", timeline(**told), ()) == said


def test_what_was_accused_without_the_fault_does_not_count():
    assert study.said_of(put(), "q", timeline(failed=["gps"]), ["gps"]) == study.NOTHING


@pytest.mark.parametrize(
    ("kind", "size", "is_beside"),
    [
        ("bias", 5.0, True),
        ("bias", -1.0, False),
        ("drift", 0.1, True),  # 6 at the end
        ("drift", 0.02, False),
        ("scale", 0.5, True),
        ("scale", 0.7, False),
        ("sign", -1.0, True),
        ("stuck", 0.0, True),
        ("noise", 5.0, True),
        ("noise", 3.0, False),
    ],
)
def test_a_sensor_that_is_clear_up_to_less_than_it_is_off_is_told(kind, size, is_beside):
    assert study.is_beside_clear(put(kind=kind, size=size), "q", timeline(clear=["q"])) is is_beside
    assert not study.is_beside_clear(put(kind=kind, size=size), "q", timeline(failed=["q"]))
