"""Several faults in one trial: as a scenario states them, as they act, and as they are scored, told and shown."""

import json
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.faults.fault import inject
from gtmbench.faults.parameter import Intermittent
from gtmbench.faults.registry import FAULTS
from gtmbench.report.words.events import trial_events
from gtmbench.report.words.judgement import trial_text
from gtmbench.report.words.study import trial_rows
from gtmbench.study.fault_tables import fault_specs
from gtmbench.values.channels import SENSORS
from gtmbench.values.record import Record
from tests.helpers.watching import scenario
from tests.study.test_score import alarm, judged, named, verdict

ONSET_S = 10.0


TWIN = {"p": "q", "psi": "phi", "ny": "nz"}  # a channel of the same unit


def table(kind, **more):
    """Return a table of any kind, with what it needs of parameters."""
    own = [more.get("channel"), *more.get("channels", [])]
    twin = next((TWIN[name] for name in own if name in TWIN), "q")
    values = {float: 0.5, int: 3, bool: True, str: "nz" if kind == "g_sensitivity" else twin}
    needed = {item.name: values[item.value_type] for item in FAULTS[kind].parameters() if item.is_required}
    return {"kind": kind, "onset_s": ONSET_S, **needed, **more}


def specs(*also, **more):
    """Return the trials of a drift of p and q with further faults."""
    block = table("drift", channels=["p", "q"], **more)
    return fault_specs("faults, table 1", {**block, **({"also": list(also)} if also else {})}, 100.0)


def flight():
    draw = np.random.default_rng(5)
    return Record(draw.normal(0.0, 3.0, (400, len(SENSORS))), channels=SENSORS, sample_period_s=0.1)


@pytest.mark.parametrize("kind", FAULTS)
@pytest.mark.parametrize("channel", ["p", "psi", "ny"])
def test_every_kind_may_be_stated_on_any_channel_with_all_that_faults_have(kind, channel):
    times = {"end_s": 30.0, "ramp_s": 2.0, "intermittent": {"period_s": 4.0, "duty": 0.5, "jitter": 0.2, "seed": 9}}
    (spec,) = fault_specs("faults, table 1", table(kind, channels=[channel], **times), 100.0)
    also = specs(table(kind, channel=channel, **times))[0].also[0]
    for fault in (spec.fault, also.fault):
        assert (fault.kind, fault.channel, fault.onset_s, fault.duration_s) == (kind, channel, ONSET_S, 20.0)
        assert (fault.ramp_s, fault.intermittent) == (2.0, Intermittent(period_s=4.0, duty=0.5, jitter=0.2, seed=9))
    assert spec.faults(flight()) == spec.absolute("") == (also.fault,)


def test_every_random_fault_has_a_seed_of_its_own():
    drawn = {kind for kind, cls in FAULTS.items() if any(item.name == "seed" for item in cls.parameters())}
    assert drawn >= {"noise", "random_walk", "spikes"}
    for kind in drawn:
        first, second = (table(kind, channel="r", seed=seed) for seed in (1, 2))
        same, other = ([spec.fault for spec in specs(first, each)[0].also] for each in (first, second))
        assert same[0] == same[1]
        assert other[0] != other[1]
        records = [inject(flight(), fault)["r"] for fault in other]
        assert (records[0] != records[1]).any()


def test_further_faults_act_in_the_order_of_the_file_on_the_trials_channel_or_their_own():
    clip = table("saturation", limit=1.0, onset_s=20.0)
    stuck = table("jam", channel="r", onset_s=30.0, duration_s=2.0)
    for spec, channel in zip(specs(clip, stuck), "pq", strict=True):
        faults = spec.faults(flight())
        assert [(fault.kind, fault.channel, fault.onset_s) for fault in faults] == [
            ("drift", channel, ONSET_S),
            ("saturation", channel, 20.0),
            ("jam", "r", 30.0),
        ]
        broken = inject(flight(), faults)
        assert np.abs(broken[channel][200:]).max() == 1.0  # clipped after the drift, which is far beyond by then
        other = inject(flight(), [faults[1], faults[0], faults[2]])
        assert np.abs(other[channel][200:]).max() > 10.0
        assert len(set(broken["r"][300:320])) == 1


def test_relative_severities_are_shares_of_each_faults_own_channel():
    (spec, _) = specs(table("saturation", channel="tas", limit="50 % of peak"), slope="10 % of slew")
    first, other = spec.faults(flight())
    steps, tas = np.diff(flight()["p"]), flight()["tas"] - flight()["tas"].mean()
    assert first.slope == pytest.approx(0.1 * np.abs(steps).max() / 0.1)
    assert other.limit == pytest.approx(0.5 * np.abs(tas).max())


WRONG = {
    "channels": (
        [table("jam", channels=["r"])],
        {},
        "also 1: a fault of [[faults.also]] has one channel, not channels",
    ),
    "list": (
        [table("jam", channel="r"), table("drift", slope=[1, 2])],
        {},
        "also 2: a list of severities would be more",
    ),
    "key": ([table("jam", slop=1)], {}, "also 1: unknown key 'slop'; a jam has kind, channel, onset_s"),
    "channel": ([table("jam", channel="w")], {}, "also 1: channel: no channel that can break is 'w'"),
    "no onset": ([{"kind": "jam"}], {}, "also 1: key 'onset_s' is missing"),
    "late": ([table("jam", onset_s=101)], {}, "also 1: onset_s is 101"),
    "expect": ([table("jam", expect={})], {}, "unknown key 'expect'"),
    "nested": ([table("jam", also=[])], {}, "unknown key 'also'"),
    "no tables": ([], {"also": "jam"}, "also is 'jam'; write further faults of the trial as [[faults.also]] tables"),
    "both ends": ([], {"end_s": 20, "duration_s": 5}, "both duration_s and end_s are given; keep one"),
    "end": ([], {"end_s": 10}, "end_s is 10; it must be a finite number greater than 10"),
    "ramp": ([], {"ramp_s": -1}, "ramp_s is -1"),
    "no table": ([], {"intermittent": 3}, "intermittent is 3; it must be a table, {period_s = ..., duty = ...}"),
    "no duty": ([], {"intermittent": {"period_s": 3}}, "intermittent: key 'duty' is missing"),
    "duty": ([], {"intermittent": {"period_s": 3, "duty": 2}}, "intermittent: duty is 2"),
    "more": ([], {"intermittent": {"period_s": 3, "duty": 0.5, "phase": 1}}, "intermittent: unknown key 'phase'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_cant_be_meant_is_one_line_that_names_the_place(case):
    also, more, message = WRONG[case]
    with pytest.raises(gb.InputError) as raised:
        specs(*also, **more)
    assert str(raised.value).startswith("faults, table 1")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("kind", "value", "legal"),
    [
        ("lag", "50 % of rms", "a number in s"),
        ("scale_factor", "50 % of rms", "a number"),
        ("random_walk", "50 % of rms", "a number in the channel's unit per sqrt(s)"),
        ("bias", "50 % of slew", "a number in the channel's unit or '20 % of rms' or '20 % of peak'"),
        ("drift", "50 % of rms", "a number in the channel's unit per second or '20 % of slew'"),
    ],
)
def test_a_share_is_legal_where_a_channel_has_such_a_measure(kind, value, legal):
    (item,) = [item for item in FAULTS[kind].parameters() if item.is_severity]
    with pytest.raises(gb.InputError) as raised:
        fault_specs("table", table(kind, channels=["p"], **{item.name: value}), 100.0)
    assert str(raised.value) == f"table: {item.name} is '{value}'; it must be {legal}"


# scoring: the second fault, of r, begins 3 s after the first, of p
LATER = gb.Jam(channel="r", onset_s=13.0)
EARLIER = gb.Jam(channel="r", onset_s=8.0)


def both(alarms, also=(LATER,)):
    healthy = Record(np.ones((20, 2)), channels=["p", "r"], sample_period_s=1.0)
    return named(
        alarms, also=also, records=(healthy, inject(healthy, [gb.Drift(channel="p", onset_s=10.0, slope=1.0)]))
    )


def test_the_delay_counts_from_the_earliest_onset():
    assert (both([9.0]).onset_s, both([9.0]).detected, both([9.0]).false_alarms) == (10.0, False, 1)
    early = both([9.0], also=(EARLIER,))
    assert (early.onset_s, early.detection_delay_s, early.false_alarms) == (8.0, 1.0, 0)


def test_the_sensor_of_any_fault_that_had_begun_is_right():
    first = both([alarm(judged(12.0, "p"))])
    assert (first.isolated, first.named_wrong, first.axis_right) == (True, False, True)
    second = both([alarm(judged(12.0, "p", "r"), judged(14.0, "r"))])
    assert (second.isolated, second.named_wrong, second.isolation_delay_s) == (True, False, 4.0)
    too_soon = both([alarm(judged(12.5, "r"))])
    assert (too_soon.isolated, too_soon.named_wrong, too_soon.axis_right) == (False, True, False)
    other = both([alarm(judged(14.0, "q"))])
    assert (other.isolated, other.named_wrong, other.axis_right) == (False, True, False)


def test_the_kind_is_that_of_a_fault_of_the_sensor_that_is_named():
    for sensor, kind, right in (("r", "jam", True), ("r", "drift", False), ("p", "drift", True), ("p", "jam", False)):
        assert both([alarm(judged(14.0, sensor, kind=kind))]).kind_right is right


@pytest.mark.parametrize(
    ("candidates", "wrong", "axis"),
    [
        (("p", "phi"), False, True),
        (("phi",), True, True),
        (("p", "phi", "q"), False, False),
        (("theta",), True, False),
        (("p", "r", "psi"), False, False),
        ((), False, False),
    ],
)
def test_the_axis_is_right_where_all_that_is_left_lies_on_it(candidates, wrong, axis):
    result = named([alarm(judged(12.0, *candidates))])
    assert (result.isolated, result.named_wrong, result.axis_right) == (False, wrong, axis)


def test_who_names_nobody_is_on_no_axis_and_a_miss_neither():
    assert (verdict([12.0]).named_wrong, verdict([12.0]).axis_right) == (None, None)
    assert (named([]).named_wrong, named([]).axis_right) == (False, False)
    assert (named([12.0]).named_wrong, named([12.0]).axis_right) == (False, False)


def test_of_a_channel_without_a_twin_the_axis_is_itself():
    fault = gb.Jam(channel="tas", onset_s=10.0)
    result = named([alarm(judged(12.0, "tas"))], fault=fault, channel="tas", channels=("tas",))
    assert (result.isolated, result.axis_right) == (True, True)


TEXT = """
duration_s = 30.0
excitation = "multisine"
noise = "t2"
severity_reference_s = [5.0, 20.0]
[operator]
identify_s = [5.0, 15.0]
[alarm]
threshold_s = [15.0, 25.0]
watch_from_s = 5.0
healthy_records = 1
[[faults]]
kind = "jam"
channels = ["p"]
onset_s = 21.0
end_s = 24.0
[[faults.also]]
kind = "drift"
channel = "beta"
onset_s = 22.0
slope = 0.5
[[faults.also]]
kind = "saturation"
onset_s = 23.0
limit = "10 % of peak"
"""


def spikes(record):
    """Alarm where p stands still."""
    still = np.abs(np.diff(record["p"], prepend=np.nan)) == 0.0
    return record.time_s[still][:1]


@cache
def study():
    return gb.run_study([scenario("three", TEXT)], detectors=[spikes])


def test_a_trial_holds_every_fault_and_the_record_that_they_made():
    (trial,) = study().trials
    healthy = study().baseline.healthy
    assert [fault.kind for fault in trial.also] == ["drift", "saturation"]
    assert trial.channels == ("p", "beta")
    assert (trial.record.values == inject(healthy, [trial.injected, *trial.also]).values).all()
    assert (trial.onset_s, trial.detected, round(trial.detection_delay_s, 6)) == (21.0, True, 0.0)


def test_rows_tables_and_events_tell_of_every_fault():
    (trial,) = study().trials
    also = trial.row()["also"]
    assert [(each["fault"], each["channel"], each["onset_s"]) for each in also] == [
        ("drift", "beta", 22.0),
        ("saturation", "p", 23.0),
    ]
    assert also[0]["severity"] == {"slope": 0.5}
    json.dumps(trial.row()["also"])
    columns, rows, _ = trial_rows(study())
    assert rows[0][columns.index("also")].startswith("drift of beta, 0.5 deg/s, from 22 s; saturation of p, ")
    assert trial_text(trial).startswith("jam of p + drift of beta, 0.5 deg/s + saturation of p, ")
    told = [(time_s, text) for time_s, _, text in trial_events(trial)]
    assert {(21.0, "onset: jam of p"), (24.0, "end of the jam of p"), (22.0, "onset: drift of beta, 0.5 deg/s")} <= {
        *told
    }
    one = gb.run_study([scenario("one", TEXT[: TEXT.index("[[faults.also]]")])], detectors=[spikes])
    assert "also" not in trial_rows(one)[0]


def test_a_recording_holds_every_broken_channel_and_the_files_every_fault(frame_of, tmp_path):
    from gtmbench.report.tables.results import write_results

    (trial,) = study().trials
    frame = frame_of(study)
    measured = frame[frame["entity"] == "/trials/three/p/also/beta"]
    there = np.isin(trial.record.time_s, measured["time_s"])
    assert there.any()
    assert (measured["value"].to_numpy() == trial.record["beta"][there]).all()
    fields = frame[frame["entity"] == "/trials/three/p/verdict"].set_index("series")
    assert fields.loc["also.0.fault", "text"] == "drift"
    assert fields.loc["also.1.severity.limit", "value"] == trial.also[1].limit
    write_results(study(), tmp_path)
    assert json.loads((tmp_path / "results.json").read_text())["trials"][0]["also"][1]["channel"] == "p"
    assert "drift of beta at 22.0 slope=0.5; saturation of p at 23.0 limit=" in (tmp_path / "trials.csv").read_text()


def test_several_ready_faults_in_one_trial():
    first, second = gb.Jam(channel="q", onset_s=21.0), gb.Drift(channel="r", onset_s=22.0, slope=0.5)
    trials = gb.run(scenario("three", TEXT), detectors=[spikes], faults=[(first, second), second])
    assert [(trial.injected, trial.also) for trial in trials] == [(first, (second,)), (second, ())]
