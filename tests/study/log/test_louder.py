"""Residuals far above what they were: silence about them says nothing."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.report.words.verdict import verdict_text
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import State
from tests.helpers import monitors

PERIOD_S, ONSET_S = 0.1, 150.0


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    path = tmp_path_factory.mktemp("louder") / "log.csv"
    gb.write_log(monitors.record(2600, 5, PERIOD_S).select([*GYROS, *ATTITUDE]), path)
    return gb.watch_log(path, "auto", healthy=[(0.0, 130.0)])


@pytest.mark.parametrize(
    ("times", "is_judged", "is_told"), [(1.0, True, False), (9.0, True, True), (9.0, False, False)]
)
def test_a_residual_far_louder_than_where_it_was_learnt_is_no_all_clear(healthy, times, is_judged, is_told):
    """As if samples had been lost so often, or the noise's tail had been so heavy, that no test could alarm."""
    (watch,) = healthy.watches
    later = watch.record.time_s > ONSET_S
    residuals = {**watch.residuals, "r": watch.residuals["r"] * np.where(later, times, 1.0)}
    score = replace(watch.scores["r"], armed=watch.scores["r"].armed & (is_judged | ~later))
    told = replace(healthy, watches=(replace(watch, residuals=residuals, scores={**watch.scores, "r": score}),))
    assert healthy.outcome is gb.Outcome.HEALTHY
    assert [each.sensor for each in told.louder] == (["r"] if is_told else [])
    assert (told.outcome is gb.Outcome.UNKNOWN) == is_told
    if is_told:
        assert told.louder[0].times == pytest.approx(times, rel=0.3)
        assert told.louder[0].end_s > ONSET_S
        assert told.verdict.unjudged == ("r", "psi")
        assert told.timeline.at("r", ONSET_S).state is told.timeline.at("psi", ONSET_S).state is State.NOT_JUDGED
        assert verdict_text(told).startswith("Cannot tell for r and psi: the residual of r stood ")
