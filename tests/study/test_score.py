"""Scoring: watches made by hand, with verdicts that can be read off."""

from types import SimpleNamespace

import numpy as np
import pytest

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.protocol import Score, Watch
from gtmbench.faults.fault import inject
from gtmbench.faults.kinds.additive import Bias, Drift, Oscillation, Spikes
from gtmbench.faults.kinds.replacing import Hardover, Jam, Stuck
from gtmbench.faults.kinds.shaping import Deadzone, Hysteresis, Misalignment, Saturation
from gtmbench.faults.registry import FAULTS
from gtmbench.method.residual import came_down
from gtmbench.study.score import SAME_KINDS, false_alarms, score
from gtmbench.values.record import Record

# a second a sample; E(k) needs k..k+2 and one sample of look-ahead, so it is known 3 s after k
SAMPLES, ONSET_S, THRESHOLD = 20, 10.0, 2.0
KNOWN_AFTER_S = 3
HEALTHY = np.linspace(1.0, 2.0, SAMPLES)
ISOLATION = (
    "isolated",
    "named_wrong",
    "axis_right",
    "isolated_s",
    "isolation_delay_s",
    "sensor",
    "kind",
    "kind_right",
    "kind_right_20s",
)


def alarms_at(*times):
    """Alarms that name nobody, each a fault of its own."""
    return [Alarm(number=i, time_s=t, onset_s=t, source="E(k)") for i, t in enumerate(sorted(times))]


def norm_of(values, *, name="E(k)", channels=("p", "r"), disarmed_s=None):
    """A score of one value, or one a sample."""
    values = np.full(SAMPLES, values) if np.isscalar(values) else np.array(values, dtype=float)
    known_s = np.arange(float(SAMPLES)) + KNOWN_AFTER_S
    armed = came_down(values, THRESHOLD)
    if disarmed_s is not None:
        armed &= known_s < disarmed_s
    return Score(
        name=name,
        values=values,
        known_s=known_s,
        threshold=THRESHOLD,
        channels=channels,
        armed=armed,
        disarmed_s=disarmed_s,
    )


def verdict(
    alarms=(),
    norm=1.0,
    *,
    scores=None,
    altered=range(10, SAMPLES),
    fault=None,
    onset_s=ONSET_S,
    duration_s=None,
    healthy=HEALTHY,
    channel="p",
    channels=("p", "r"),
    suspects=(),
    also=(),
    records=None,
):
    """Score alarms (or their times), a norm and a fault that altered those samples."""
    changed = healthy.copy()
    changed[list(altered)] += 0.5
    fault = fault or Drift(channel=channel, onset_s=onset_s, duration_s=duration_s, slope=1.0)
    before, after = records or (Record(y, channels=[channel], sample_period_s=1.0) for y in (healthy, changed))
    if not all(isinstance(alarm, Alarm) for alarm in alarms):
        alarms = alarms_at(*alarms)
    shown = [norm_of(norm)] if scores is None else scores
    watched = Watch(
        monitor=SimpleNamespace(name="mine", channels=channels, suspects=suspects, look_ahead_s=1.0),
        record=after,
        scores={each.name: each for each in shown},
        alarms=tuple(alarms),
    )
    return score(watched, fault=fault, also=also, healthy=before, broken=after)


def judged(time_s, *candidates, **more):
    """A judgement; of one candidate, it has decided."""
    return Judgement(
        time_s=time_s, sensor=candidates[0] if len(candidates) == 1 else None, candidates=candidates, **more
    )


def named(alarms, **more):
    """The verdict on a detector that names sensors."""
    return verdict(alarms, suspects=("p", "r"), **more)


def one_window(k, value):
    """Return a norm that is low but for window k."""
    norm = np.full(SAMPLES, 0.5)
    norm[k] = value
    return norm


ABOVE = [1.0, 1.0, *[3.0] * (SAMPLES - 2)]  # the alarm of the transient can't be had twice: none after the onset
HOLED = np.where(np.isin(np.arange(SAMPLES), (12, 13)), np.nan, HEALTHY)
FIRST = int(ONSET_S) - KNOWN_AFTER_S
OWN, OTHERS = norm_of(1.0, name="p", channels=("p",)), norm_of(1.9, name="r", channels=("r",))
ANYBODYS = norm_of(1.6, name="x", channels=())  # doesn't say whose faults enter it
LAST = [1.0] * 7 + [np.nan] * (SAMPLES - 7)
STANDS, NEVER = (
    "the score stood above its threshold since before the onset",
    "the score never came down to its threshold",
)
SCORED = {
    "at the very onset": (
        verdict([ONSET_S]),
        {"detected": True, "alarm_time_s": 10.0, "false_alarms": 0, "reason": ""},
    ),
    "without delay": (verdict([ONSET_S]), {"detection_delay_s": 0.0}),
    "the first after it": (verdict([4.0, 9.0, 12.5, 15.0]), {"alarm_time_s": 12.5, "detection_delay_s": 2.5}),
    "those before are false": (verdict([4.0, 9.0, 12.5, 15.0]), {"detected": True, "false_alarms": 2}),
    "before it alone": (verdict([9.0]), {"detected": False, "false_alarms": 1, "alarm_time_s": None}),
    "the method's part": (verdict([14.0]), {"detection_delay_s": 4.0, "look_ahead_s": 1.0}),
    "0.1 + 0.2 is a hair more than 0.3": (verdict([0.3], onset_s=0.1 + 0.2), {"detection_delay_s": 0.0}),
    "above since before it": (verdict([5.0], norm=ABOVE), {"detected": False, "false_alarms": 1, "peak_ratio": 1.5}),
    "why that is a miss": (verdict([5.0], norm=ABOVE), {"reason": STANDS}),
    "above from the start": (verdict(norm=3.0), {"detected": False, "false_alarms": 0, "peak_ratio": 1.5}),
    "why that can't tell": (verdict(norm=3.0), {"reason": f"can't tell: {NEVER}"}),
    "no sample changed": (verdict(altered=()), {"altered_share": 0.0, "reason": "the fault changed no sample"}),
    "a channel that isn't used": (verdict(channel="q"), {"reason": "mine doesn't use this channel"}),
    "who doesn't say what it uses": (verdict(channel="q", channels=(), scores=[]), {"reason": "no alarm came"}),
    "and finds it": (verdict([12.0], channel="q", channels=(), scores=[]), {"peak_ratio": 0.0}),
    "how near it came": (verdict(norm=1.7), {"reason": "the score reached 85 % of its threshold"}),
    "by the scores that it enters": (verdict(scores=[OWN, OTHERS]), {"peak_ratio": 0.5}),
    "by those of another channel": (verdict(scores=[OWN, OTHERS], channel="r"), {"peak_ratio": 0.95}),
    "by one that anybody may enter": (verdict(scores=[OWN, ANYBODYS]), {"peak_ratio": 0.8}),
    "a window known before the onset": (verdict(norm=one_window(FIRST - 1, 1.8)), {"peak_ratio": 0.25}),
    "a window known at the onset": (verdict(norm=one_window(FIRST, 1.8)), {"peak_ratio": 0.9}),
    "the last window": (verdict(norm=one_window(SAMPLES - 1, 1.8)), {"peak_ratio": 0.9}),
    "a missing window": (verdict(norm=one_window(12, np.nan)), {"peak_ratio": 0.25}),
    "after the last window": (verdict(norm=LAST), {"peak_ratio": 0.0, "reason": "no score is known after the onset"}),
    "half of the samples after it": (verdict(altered=range(10, 15)), {"altered_share": 0.5}),
    "one of them": (verdict(altered=[13]), {"altered_share": 0.1}),
    "until the fault's end": (verdict(altered=[10, 11], duration_s=4.0), {"altered_share": 0.5}),
    "missing before": (
        verdict(altered=(), healthy=HOLED),
        {"altered_share": 0.0, "reason": "the fault changed no sample"},
    ),
    "detected, with a low norm": (verdict([11.0], norm=0.1), {"reason": ""}),
    "detected, with a high norm": (verdict([11.0], norm=3.0), {"reason": ""}),
}


@pytest.mark.parametrize("case", SCORED)
def test_what_is_scored_is_what_can_be_read_off(case):
    result, told = SCORED[case]
    assert {name: getattr(result, name) for name in told} == pytest.approx(told)


def test_alarms_that_count_to_an_earlier_ones_fault_are_one_false_alarm():
    first, second, third = alarms_at(2.0, 4.0, 6.0)
    second = Alarm(number=1, time_s=4.0, onset_s=4.0, source="r", fault=0)
    assert verdict([first, second, third]).false_alarms == 2
    result = verdict([first, second, third, Alarm(number=3, time_s=12.0, onset_s=11.0, source="r", fault=0)])
    assert (result.false_alarms, result.detection_delay_s) == (2, 2.0)  # one could be raised, whatever it counts to


def test_on_a_healthy_record_every_fault_that_was_told_of_is_a_false_alarm():
    record = Record(HEALTHY, channels=["p"], sample_period_s=1.0)
    first, second = alarms_at(2.0, 15.0)
    linked = Alarm(number=2, time_s=16.0, onset_s=16.0, source="r", fault=1)
    watched = Watch(monitor=None, record=record, alarms=(first, second, linked))
    assert false_alarms(watched) == (first, second)


def test_what_a_judgement_disarmed_says_since_when():
    result = verdict([5.0], scores=[norm_of(3.0, disarmed_s=6.25)])
    assert (result.detected, result.false_alarms) == (False, 1)
    assert result.reason == "no longer watched since 6.25 s: the fault of an earlier alarm was taken to last"
    both = [norm_of(1.7, name="p"), norm_of(3.0, name="r", disarmed_s=6.25)]
    assert verdict(scores=both).reason != result.reason  # one of them could still have alarmed


def test_who_names_nobody_is_neither_right_nor_wrong():
    for alarms in ([], [12.0]):
        result = verdict(alarms)
        assert [getattr(result, name) for name in ISOLATION] == [None] * len(ISOLATION)
        assert (result.candidates, result.parameters, result.verdict) == ((), (), "")


def test_who_could_name_a_sensor_and_didnt_isolated_nothing():
    for alarms, said in (([], ""), ([12.0], "alarm")):
        result = named(alarms)
        assert (result.isolated, result.kind_right, result.kind_right_20s, result.verdict) == (
            False,
            False,
            False,
            said,
        )
        assert (result.isolated_s, result.sensor, result.kind) == (None, None, None)


def alarm(*judgements, number=0, time_s=11.0, **more):
    return Alarm(number=number, time_s=time_s, onset_s=time_s, source="p", judgements=judgements, **more)


def test_a_sensor_is_isolated_when_the_decision_was_possible_that_the_end_confirms():
    drift = {"kind": "drift", "parameters": {"slope": 0.9, "onset_s": 9.5}, "intervals": {"slope": (0.8, 1.0)}}
    result = named([alarm(judged(12.0, "p", "r"), judged(14.0, "p"), judged(16.0, "p", **drift))])
    assert (result.isolated, result.isolated_s, result.isolation_delay_s) == (True, 14.0, 4.0)
    assert (result.sensor, result.candidates, result.verdict) == ("p", ("p",), "p failed")
    assert (result.kind, result.kind_right, result.kind_right_20s) == ("drift", True, True)
    slope, onset = result.parameters
    assert (slope.name, slope.value, slope.low, slope.high, slope.true) == ("slope", 0.9, 0.8, 1.0, 1.0)
    assert (onset.name, onset.value, onset.true) == ("onset_s", 9.5, 10.0)
    assert np.isnan(onset.low)


def test_a_wrong_sensor_or_kind_has_no_truth_beside_it():
    wrong = named([alarm(judged(14.0, "r", kind="drift", parameters={"slope": 1.0}))])
    assert (wrong.detected, wrong.isolated, wrong.isolated_s, wrong.kind_right) == (True, False, None, False)
    assert wrong.parameters[0].true is None
    other = named([alarm(judged(14.0, "p", kind="jam", parameters={"slope": 1.0}))])
    assert (other.isolated, other.kind_right, other.parameters[0].true) == (True, False, None)


def test_a_jams_true_value_is_what_the_channel_reads_then():
    stuck = Jam(channel="p", onset_s=ONSET_S)
    result = named([alarm(judged(14.0, "p", kind="jam", parameters={"value": 2.0}))], fault=stuck)
    assert result.parameters[0].true == HEALTHY[10] + 0.5


def told(fault, kind, parameters=None):
    """The verdict on a kind that is told of what a fault makes of noise about 10 that runs from 8 to 12."""
    channels = list(dict.fromkeys([*fault.reads, "p"]))
    noise = np.random.default_rng(1).uniform(8.0, 12.0, (SAMPLES, len(channels)))
    before = Record(noise, channels=channels, sample_period_s=1.0)
    said = alarm(judged(14.0, "p", kind=kind, parameters=parameters or {}))
    return named([said], fault=fault, records=(before, inject(before, fault)))


@pytest.mark.parametrize(
    ("fault", "right"),
    [
        (Stuck(channel="p", onset_s=ONSET_S, value=100.0), {"stuck", "hardover"}),
        (Stuck(channel="p", onset_s=ONSET_S, value=-12.5), {"stuck", "hardover"}),
        (Stuck(channel="p", onset_s=ONSET_S), {"stuck"}),
        (Stuck(channel="p", onset_s=ONSET_S, value=10.0), {"stuck", "jam"}),
        (Hardover(channel="p", onset_s=ONSET_S, limit=100.0, rate_limit=20.0), {"hardover", "stuck"}),
        (Jam(channel="p", onset_s=ONSET_S), {"jam", "stuck"}),
        (Bias(channel="p", onset_s=ONSET_S, size=1.0), {"bias"}),
        (Saturation(channel="p", onset_s=ONSET_S, limit=5.0), {"saturation", "stuck"}),
        (Saturation(channel="p", onset_s=ONSET_S, limit=9.9), {"saturation"}),
        (Deadzone(channel="p", onset_s=ONSET_S, half_width=5.0), {"deadzone", "bias"}),
        (Deadzone(channel="p", onset_s=ONSET_S, half_width=50.0), {"deadzone", "stuck"}),
        (Deadzone(channel="p", onset_s=ONSET_S, half_width=9.9), {"deadzone"}),
        (Hysteresis(channel="p", onset_s=ONSET_S, width=50.0), {"hysteresis", "jam", "stuck"}),
        (Hysteresis(channel="p", onset_s=ONSET_S, width=0.1), {"hysteresis"}),
    ],
)
def test_kinds_that_are_physically_the_same_are_right_and_no_others(fault, right):
    assert {kind for kind in [*FAULTS, "unknown"] if told(fault, kind).kind_right} == right
    assert {pair for pair in SAME_KINDS if pair[0] == fault.kind} >= {
        (fault.kind, kind) for kind in right - {fault.kind}
    }


def test_where_nothing_was_read_before_only_the_name_counts():
    at_once = Stuck(channel="p", onset_s=0.0, value=100.0)
    assert [told(at_once, kind).kind_right for kind in ("stuck", "hardover", "jam")] == [True, False, False]


@pytest.mark.parametrize(
    ("fault", "true"),
    [
        (Bias(channel="p", onset_s=ONSET_S, size=1.5), {"size": 1.5, "onset_s": ONSET_S}),
        (Stuck(channel="p", onset_s=ONSET_S, value=1.5), {"value": 1.5}),
        (Hardover(channel="p", onset_s=ONSET_S, limit=-90.0, rate_limit=1.0), {"value": -90.0}),
        (Spikes(channel="p", onset_s=ONSET_S, size=1.5, rate_hz=0.5), {"size": 1.5, "rate_hz": 0.5}),
        (
            Oscillation(channel="p", onset_s=ONSET_S, amplitude=1.5, frequency_hz=0.2),
            {"amplitude": 1.5, "frequency_hz": 0.2},
        ),
        (Misalignment(channel="p", onset_s=ONSET_S, axis="q", angle_deg=-5.0), {"angle_deg": -5.0}),
    ],
)
def test_the_truth_stands_beside_every_parameter_that_a_diagnosis_names(fault, true):
    result = told(fault, fault.kind, dict.fromkeys(true, 0.0))
    assert {each.name: each.true for each in result.parameters} == true


def test_the_value_of_a_jam_that_comes_in_slowly_is_where_it_arrives():
    jam = Jam(channel="p", onset_s=ONSET_S, ramp_s=5.0)
    (value,) = told(jam, "jam", {"value": 0.0}).parameters
    (at_once,) = told(Jam(channel="p", onset_s=ONSET_S), "jam", {"value": 0.0}).parameters
    assert value.true == pytest.approx(at_once.true, rel=1e-12)


def test_the_other_sensor_and_why_none_is_named_are_part_of_a_verdict():
    result = named([alarm(judged(14.0, "p", kind="swap", partner="r"))])
    assert (result.partner, result.kind, result.reason) == ("r", "swap", "")
    result = named([alarm(judged(14.0, "p", "r", reason="both may be"))])
    assert (result.detected, result.sensor, result.partner, result.reason) == (True, None, None, "both may be")


def test_kinds_are_judged_at_the_end_and_20_s_after_the_alarm():
    late = alarm(judged(12.0, "p", kind="jam"), judged(31.5, "p", kind="drift"))
    assert (named([late]).kind_right, named([late]).kind_right_20s) == (True, False)


def test_what_is_said_of_a_fault_stands_with_the_alarm_that_first_told_of_it():
    first = alarm(judged(9.5, "p"), time_s=9.0)
    again = alarm(number=1, time_s=12.0, fault=0)
    result = named([first, again])
    assert (result.false_alarms, result.sensor, result.isolated) == (1, "p", True)
    assert result.isolated_s == result.alarm_time_s == 12.0  # not before the fault that is scored


def test_an_end_is_told_and_how_late():
    gone = alarm(judged(12.0, "p"), judged(15.0), ended_s=14.5, end_known_s=15.0)
    result = named([gone], duration_s=4.0)
    assert (result.isolated, result.sensor, result.ended_s, result.end_error_s) == (True, "p", 14.5, 0.5)
    lasting = named([gone])
    assert (lasting.ended_s, lasting.end_error_s) == (14.5, None)
