"""Timelines and verdicts made by hand, and drawn ones: what nobody has to watch a log for."""

from hypothesis import strategies as st

from gtmbench.detectors.alarm import Judgement
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, laid_out
from gtmbench.verdict.verdict import verdict_of

ALL = ("p", "q", "r", "phi", "theta", "psi")
END_S = 180.0
GYRO = Sizes(error=0.5, within_s=60.0, factors=(0.7, 1.3), noise=1.2)
ANGLE = Sizes(error=2.0, within_s=60.0)


def span(state, start_s=0.0, end_s=END_S, **told):
    return SensorSpan(start_s=start_s, end_s=end_s, state=state, **told)


def clear(start_s=0.0, end_s=END_S, sensors=ALL):
    """Return claims that sensors are clear, to be changed."""
    return {name: [span(State.CLEAR, start_s, end_s, sizes=GYRO if name in "pqr" else ANGLE)] for name in sensors}


def unjudged(why, start_s=0.0, end_s=END_S):
    return span(State.NOT_JUDGED, start_s, end_s, reason=why)


def failed(sensor, start_s, end_s, **judged):
    """Return that a sensor failed; a bias of 3 deg/s where nothing else is given."""
    fault = {"kind": "bias", "parameters": {"size": 3.0, "onset_s": start_s}} | judged
    judgement = Judgement(time_s=start_s + 2.0, sensor=sensor, candidates=(sensor,), **fault)
    return span(State.FAILED, start_s, end_s, judgement=judgement)


def suspected(names, start_s, end_s, reason="both explain it"):
    """Return that one of some sensors failed."""
    judgement = Judgement(time_s=start_s + 2.0, sensor=None, candidates=tuple(names), kind="bias", reason=reason)
    return span(State.SUSPECTED, start_s, end_s, suspects=tuple(names), judgement=judgement, reason=reason)


def verdict(claims, *, asked=ALL, motion_s=((0.0, END_S),), told=(), **scope):
    timeline = laid_out((0.0, END_S), claims, motion_s=motion_s, told=told)
    return verdict_of(timeline, Scope(sensors=asked, **scope))


SENSORS = ("p", "q", "phi", "tas")
SPANS = [(10.0 * start, 10.0 * end) for start in range(18) for end in range(start + 1, 19)]
SIZES = [
    Sizes(error=error, within_s=60.0, factors=factors)
    for error in (0.1, 0.5, 3.0, 20.0)
    for factors in (None, (0.7, 1.4))
]
SUSPECTS = [("p", "phi"), ("q",), ("p", "q", "phi"), ("tas", "q")]
MOTION = [[(0.0, END_S)], [(40.0, END_S)], [(20.0, 60.0), (90.0, 120.0)], []]


def _claims_of(sensor):
    """Return all that may be claimed of a sensor."""
    every = [span(State.CLEAR, *each, sizes=sizes) for each in SPANS for sizes in SIZES]
    every += [unjudged(why, *each) for each in SPANS for why in ("contact with the ground", "too noisy")]
    every += [suspected(dict.fromkeys((sensor, *names)), *each) for each in SPANS for names in SUSPECTS]
    return every + [failed(sensor, *each) for each in SPANS]


EVERY = {sensor: _claims_of(sensor) for sensor in SENSORS}


def spans(sensor, *states):
    """Draw a claim of a sensor, in some states or in any."""
    some = [each for each in EVERY[sensor] if not states or each.state in states]
    return st.integers(0, len(some) - 1).map(some.__getitem__)


def claims():
    """Draw what is claimed of some sensors of a log."""
    own = {sensor: st.lists(spans(sensor), max_size=3) for sensor in SENSORS}
    return st.fixed_dictionaries({"q": own["q"]}, optional={name: own[name] for name in SENSORS if name != "q"})


@st.composite
def cases(draw):
    """Draw a timeline and a scope on sensors of it."""
    made = draw(claims())
    timeline = laid_out((0.0, END_S), made, motion_s=draw(st.sampled_from(MOTION)))
    asked = draw(st.lists(st.sampled_from(sorted(made)), min_size=1, unique=True))
    limit, factor = draw(st.sampled_from([(5.0, None), (0.3, None), (5.0, 0.7), (5.0, 0.8), (15.0, None)]))
    return timeline, Scope(sensors=tuple(asked), error_deg_s=limit, factor=factor)


class Judged:
    """A watched log with a verdict that is made by hand."""

    def __init__(self, watched, verdict):
        self._watched, self.verdict, self.timeline = watched, verdict, verdict.timeline

    def __getattr__(self, name):
        return getattr(self._watched, name)
