"""A gyro that reads next to nothing: it is suspected beside its angle, and nothing else is taken for one."""

from types import SimpleNamespace

import numpy as np
import pytest

from gtmbench.engine.explanations import dead
from gtmbench.engine.judged import judged
from gtmbench.engine.named import judgement_of
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import State
from tests.engine.engine_flights import flight_from
from tests.helpers.turning import motion


def fading(gyro, factor, onset_s=60.0, seed=1):
    record = motion(seed=seed)
    noise = 0.15 * np.random.default_rng(seed).standard_normal(len(record))
    return record.replace(gyro, np.where(record.time_s < onset_s, record[gyro], factor * record[gyro] + noise))


def said(record, *, is_driven=False):
    return judged(flight_from(record, is_driven=is_driven))


@pytest.mark.parametrize("factor", [0.0, 0.1])
@pytest.mark.parametrize("axis", range(3))
def test_a_gyro_that_reads_noise_alone_is_suspected_beside_its_angle(axis, factor):
    gyro, angle = GYROS[axis], ATTITUDE[axis]
    found = said(fading(gyro, factor))
    assert {sensor for sensor, _ in found.accused} == {gyro, angle}
    assert {span.state for _, span in found.accused} == {State.SUSPECTED}
    (finding,) = [each for each in found.found if each.best.kind == dead.DEAD]
    told = judgement_of(finding, 120.0)
    assert (told.kind, told.sensor) == ("scale_factor", None)
    assert told.parameters["factor"] == pytest.approx(factor, abs=0.05)
    low, high = told.intervals["factor"]
    assert low < factor + 0.02
    assert high > factor - 0.02
    assert told.parameters["onset_s"] == pytest.approx(60.0, abs=2.1)


@pytest.mark.parametrize("factor", [0.3, 0.5])
def test_a_gyro_that_reads_more_than_a_fifth_has_another_gain(factor):
    record = motion()
    found = said(record.replace("p", np.where(record.time_s < 60.0, 1.0, factor) * record["p"]))
    assert [(sensor, span.judgement.kind) for sensor, span in found.accused] == [("p", "scale_factor")]
    assert found.accused[0][1].judgement.parameters["factor"] == pytest.approx(factor, abs=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_health_has_none_nor_has_an_attitude_that_follows(seed):
    assert not said(motion(seed=seed)).accused
    assert dead.explanations(SimpleNamespace(is_driven=True, is_assumed=False)) == []
    for is_driven, is_assumed in ((False, False), (True, True)):
        made = dead.explanations(SimpleNamespace(is_driven=is_driven, is_assumed=is_assumed))
        assert [each.suspect for each in made] == [*GYROS]
        assert {each.is_gain for each in made} == {True}


def test_what_lacks_is_what_the_attitude_turns():
    flight = flight_from(motion(), is_driven=False)
    (effect,) = [each.effect(flight) for each in dead.explanations(flight) if each.suspect == "q"]
    assert effect.gyros is None
    np.testing.assert_array_equal(effect.gains[:, 1], -np.nan_to_num(flight.blocks.rates[:, 1]))
    assert not effect.gains[:, [0, 2]].any()
