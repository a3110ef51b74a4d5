"""A healthy log, and findings on it that nothing speaks against, or something in particular."""

import pytest

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.explanations.registry import explanations_of
from gtmbench.engine.finding import FROZEN, Finding
from gtmbench.engine.model import learnt
from gtmbench.engine.relation import Effect
from gtmbench.engine.relations.registry import relations_of
from gtmbench.engine.sums import SignatureSet
from tests.engine.engine_flights import flight_from
from tests.helpers.turning import motion

DURATION_S = 200.0


def model_of(record):
    flight = flight_from(record, noise=0.05)
    return learnt(flight, relations_of(flight), SignatureSet(flight, explanations_of(flight)))


@pytest.fixture(scope="module")
def model():
    """A healthy log of 200 s that turns about all axes throughout."""
    return model_of(motion(DURATION_S, seed=5))


@pytest.fixture(scope="module")
def explanations(model):
    return {each.name: each for each in model.explanations}


def nothing(_):
    return Effect()


@pytest.fixture(scope="module")
def finding(explanations):
    """Return a finding of an explanation that nothing speaks against, or something in particular."""

    def of(name="q bias", onset_s=60.0, end_s=DURATION_S, **rest):
        names = (name,) if isinstance(name, str) else name
        own = {
            "first": int(onset_s) - 1,
            "last": int(end_s),
            "onset_s": onset_s,
            "end_s": end_s,
            "onset_range_s": (onset_s - 1.0, onset_s + 1.0),
            "ranked": tuple((explanations[each], float(place)) for place, each in enumerate(names)),
            "size": 2.0,
            "interval": (1.8, 2.2),
            "evidence": 100.0,
            "own_axis": 90.0,
            "shown": 95.0,
        }
        return Finding(**{**own, **rest})

    return of


def frozen(gyro, onset_s, end_s):
    return Finding(
        first=int(onset_s),
        last=int(end_s),
        onset_s=onset_s,
        end_s=end_s,
        onset_range_s=(onset_s, onset_s),
        ranked=((Explanation(suspect=gyro, kind=FROZEN, effect=nothing), 0.0),),
        size=1.0,
        interval=(1.0, 1.0),
        evidence=50.0,
        own_axis=50.0,
        shown=50.0,
    )
