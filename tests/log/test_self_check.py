"""The self-check: every mutation of a healthy flight is refused with its cause, a fault that comes in never is."""

import json
import shlex
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.bank import bank_of
from gtmbench.log.self_check.causes import (
    WiringChange,
    WiringGuess,
    as_it_is,
    causes_among,
    guesses,
    holds,
    other_scales,
    small_lags_s,
    undone,
)
from gtmbench.log.self_check.explained_motion import _explained
from gtmbench.log.watch import watch_log
from gtmbench.values.channels import ATTITUDE, GYROS, axis_of
from gtmbench.verdict.timeline import State
from gtmbench.verdict.verdict import Outcome
from recorded.mutations import MORE_MUTATIONS, MUTATIONS, Mutation, is_cause, mutated
from tests.helpers.airliner import airliner
from tests.helpers.night import by_day

SIX = ("p", "q", "r", "phi", "theta", "psi")
ALL = {**MUTATIONS, **MORE_MUTATIONS}
WRONG = {name: mutation for name, mutation in ALL.items() if mutation != Mutation()}
C = gb.load_bank("C")
HALF = [(0.0, 40.0)]


def cause_of(records):
    """Return the guesses that are the cause of what is wrong with some records."""
    return causes_among(guesses(records), records)


@cache
def flight(seed=90001):
    """Return 80 s of the GTM at 25 Hz, as the T2's sensors read them."""
    flown = gb.measure(gb.fly(excitation="multisine+turbulence", duration_s=81.1, seed=seed), noise="t2", seed=seed)
    slower = gb.decimate(flown, 4).select(SIX)
    return gb.Record(slower.values, channels=SIX, sample_period_s=0.04)


@cache
def ready():
    """Return bank C, calibrated on another flight."""
    return gb.calibrate([flight(90002)], bank=C, estimator=gb.Bayesian())


def watched(record, folder, detector=C, healthy=HALF, **options):
    gb.write_log(record, folder / "log.csv")
    return watch_log(folder / "log.csv", detector, healthy=healthy, **options)


def test_there_are_24_mutations():
    assert len(MUTATIONS) == 24


@pytest.mark.parametrize("record", [flight(), airliner("minute", 90001, duration_s=60)], ids=["GTM", "airliner"])
def test_a_healthy_flight_has_no_cause(record):
    assert cause_of([record]) == []
    assert guesses([record])[0].changes == ()
    assert min(guesses([record])[0].fits.values()) > 0.8


@pytest.mark.parametrize("name", by_day(WRONG))
def test_every_mutation_is_refused_with_its_cause_and_what_to_type_mends_it(name, tmp_path):
    mutation = ALL[name]
    found = watched(mutation.mutate(flight()), tmp_path)
    if "attitude held" in name:  # all axes alike: the intake takes what is fresh
        assert [each.kind for each in found.log.remarks] == ["held"]
        assert (found.check.causes, found.check.stops, found.alarms) == ((), (), ())
        assert (found.verdict.failed, found.verdict.suspected) == ((), ())
        others = watched(mutation.mutate(flight()), tmp_path, judge="q,phi,theta")  # at 6 Hz little of p and r shows
        assert others.outcome is Outcome.HEALTHY
        return
    if name in ("attitude 0.3 s late", "attitude 0.1 s late", "gyros 0.3 s late"):  # so it was logged
        assert (found.outcome, found.check.causes) == (Outcome.HEALTHY, ())
        assert found.reasons[0].endswith("; read in time")
        (change,) = mutation.changes
        late_s = {source.channel: source.late_s for source in found.log.sources if source.late_s}
        assert late_s == dict.fromkeys(change.channels, pytest.approx(change.size, abs=0.011))
        return
    assert (found.outcome, found.watches) == (Outcome.UNKNOWN, ())
    if mutation.dead:
        assert f"{mutation.dead} reads 0.1 all the time: dead, or held" in found.reasons[0]
        assert found.check.causes == ()
        return
    causes = found.check.causes
    assert any(is_cause(mutation, cause.changes) for cause in causes), found.reasons
    assert len(causes) == (2 if mutation.mirrored else 1)
    if "steps" in name or "said rad/s" in name:
        assert causes[0].to_type == ""  # no unit is half of another, or a 57th of deg/s
        return
    for cause in causes:
        typed = shlex.split(cause.to_type)
        assert typed[::2] == ["--map"] * (len(typed) // 2)
        mended = watch_log(tmp_path / "log.csv", C, healthy=HALF, mapping=typed[1::2])
        assert (mended.outcome, mended.reasons) == (Outcome.HEALTHY, ())


@pytest.mark.parametrize(("names", "factor"), by_day([(("p",), 0.7), (GYROS, 0.7), (("r",), 1.4), (ATTITUDE, 0.7)], 2))
def test_a_wrong_scale_from_the_beginning_is_no_all_clear(names, factor, tmp_path):
    record = flight()
    for name in names:
        record = record.replace(name, factor * record[name])
    said = watched(record, tmp_path)
    assert said.outcome is Outcome.UNKNOWN
    told = {str(doubt)[0] for doubt in said.check.doubts if "times as far as the attitude" in str(doubt)}
    assert told == {*names} or [cause.changes[0].kind for cause in said.check.causes] == ["clock"]


@pytest.mark.parametrize("record", [flight(), airliner("minute", 90001, duration_s=60)], ids=["GTM", "airliner"])
def test_a_healthy_flight_has_no_other_scale_and_no_lag(record):
    tried = guesses([record])
    assert (other_scales(tried), small_lags_s(tried)) == ({}, {})


def slowed():
    """Return the flight at 5 Hz, at which 0.1 s are half a sample."""
    return gb.Record(flight().values[::5], channels=SIX, sample_period_s=0.2)


@pytest.mark.parametrize("names", by_day(map(pytest.param, [ATTITUDE, GYROS, ("p",)])))
def test_a_lag_of_half_a_sample_is_no_all_clear(names, tmp_path):
    """What comes seldom hides a lag in the operator's look ahead; the correlation's top between samples shows it."""
    assert small_lags_s(guesses([slowed()])) == {}
    record = flight()
    for name in names:
        values = np.unwrap(record[name], period=360.0) if name == "psi" else record[name]
        record = record.replace(name, np.interp(record.time_s - 0.1, record.time_s, values))
    late = gb.Record(record.values[::5], channels=SIX, sample_period_s=0.2)
    is_read_in_time = names == GYROS  # by 0.1 s, of which too little is seen of the attitude
    assert watched(late, tmp_path).outcome is (Outcome.HEALTHY if is_read_in_time else Outcome.UNKNOWN)
    sign = 1.0 if names == ATTITUDE else -1.0
    lags_s = small_lags_s(guesses([late]))
    assert lags_s
    assert all(sign * lag_s == pytest.approx(0.1, abs=0.035) for lag_s in lags_s.values())


@pytest.mark.nightly
def test_rates_of_euler_angles_are_no_gyros(tmp_path):
    record = flight()
    rates = np.gradient(np.unwrap(record.matrix(ATTITUDE), period=360.0, axis=0), record.sample_period_s, axis=0)
    for i, name in enumerate(GYROS):
        record = record.replace(name, rates[:, i])
    found = watched(record, tmp_path)
    (cause,) = found.check.causes
    assert (found.outcome, found.watches, cause.to_type) == (Outcome.UNKNOWN, (), "")
    assert cause.text.startswith("p, q and r are the rates of phi, theta and psi")


@pytest.mark.nightly
def test_a_common_scale_of_everything_is_told_as_what_it_seems(tmp_path):
    record = flight()
    for name in (*GYROS, *ATTITUDE):
        record = record.replace(name, np.deg2rad(record[name]))
    found = watched(record, tmp_path)
    assert found.outcome is Outcome.UNKNOWN
    assert all(
        cause.text.endswith("or so it seems: a common scale hardly changes how they fit")
        for cause in found.check.causes
    )


@pytest.mark.nightly
def test_stamps_in_another_unit_are_told_with_what_to_type(tmp_path):
    gb.write_log(flight(), tmp_path / "log.csv")
    header, *lines = (tmp_path / "log.csv").read_text().splitlines()
    rows = [line.split(",", 1) for line in lines]
    rewritten = "\n".join([header, *(f"{1e3 * float(time_s):g},{rest}" for time_s, rest in rows)])
    (tmp_path / "log.csv").write_text(rewritten + "\n")
    with pytest.raises(gb.InputError, match=r"0\.025 samples a second; .* it is in ms: --map time=time_s:ms$"):
        watch_log(tmp_path / "log.csv", C, healthy=[(0.0, 40_000.0)])
    mended = watch_log(tmp_path / "log.csv", C, healthy=HALF, mapping=["time=time_s:ms"])
    assert mended.outcome is Outcome.HEALTHY


@pytest.mark.parametrize("name", by_day(["-p", "q, r swapped", "gyros in rad/s", "psi 0.5 s late", "r dead"]))
def test_a_ready_monitor_refuses_a_log_that_isnt_what_it_expects(name, tmp_path):
    found = watched(ALL[name].mutate(flight()), tmp_path, ready(), healthy=[])
    assert (found.outcome, found.watches) == (Outcome.UNKNOWN, ())
    assert "in the part watched" in found.reasons[0]
    assert ALL[name].dead or is_cause(ALL[name], found.check.causes[0].changes)


@pytest.mark.parametrize("name", by_day(["-q", "attitude 0.3 s late"]))
def test_of_several_logs_the_one_that_is_wrong_is_named(name, tmp_path):
    gb.write_log(ALL[name].mutate(flight(90003)), tmp_path / "other.csv")
    found = watched(flight(), tmp_path, healthy=[tmp_path / "other.csv"])
    assert (found.outcome, found.check.causes[0].log) == (Outcome.UNKNOWN, "other.csv")
    gb.write_log(flight(90003), tmp_path / "other.csv")
    found = watched(ALL[name].mutate(flight()), tmp_path, healthy=[tmp_path / "other.csv"])
    assert (found.outcome, found.check.causes[0].log) == (Outcome.UNKNOWN, "log.csv")


FAULTS = [
    fault
    for gyro, other in zip("pqr", "qrp", strict=True)
    for fault in (
        gb.Bias(channel=gyro, onset_s=60.0, size=3.0),
        gb.Drift(channel=gyro, onset_s=60.0, slope=1.0),
        gb.Jam(channel=gyro, onset_s=60.0),
        gb.Stuck(channel=gyro, onset_s=60.0, value=0.0),
        gb.SignFlip(channel=gyro, onset_s=60.0),
        gb.ScaleFactor(channel=gyro, onset_s=60.0, factor=0.3),
        gb.Lag(channel=gyro, onset_s=60.0, lag_s=0.5),
        gb.Delay(channel=gyro, onset_s=60.0, delay_s=0.3),
        gb.Swap(channel=gyro, onset_s=60.0, other=other),
    )
]


@pytest.mark.parametrize("fault", by_day(FAULTS), ids=lambda fault: f"{fault.kind} {fault.channel}")
def test_a_fault_that_comes_in_is_watched_and_named_not_taken_for_a_wrong_mapping(fault, tmp_path):
    broken = gb.inject(flight(), fault)
    assert cause_of([broken]) == []
    found = watched(broken, tmp_path, attitude="own")  # which no fault of a gyro bends here; nothing tells
    assert (found.check.causes, found.check.stops) == ((), ())
    if fault.kind in ("lag", "delay"):  # attitude filters and mounts do as much, so it can't be told from them
        assert (found.outcome, found.alarms[0].last.kind) == (Outcome.UNKNOWN, fault.kind)
        return
    if fault.kind == "swap":  # one explanation is of one sensor: an alarm tells, and the whole log names nobody
        assert not found.verdict.failed
        axes = {*axis_of(fault.channel), *axis_of(fault.other)}
        assert {sensor for sensor, _ in found.verdict.suspected} <= axes
        assert State.CLEAR not in {found.timeline.at(name, 80.0).state for name in (fault.channel, fault.other)}
        return
    assert found.outcome is Outcome.FAILED
    assert {alarm.sensor for alarm in found.alarms} <= {fault.channel, getattr(fault, "other", None), None}
    assert any(fault.channel in alarm.verdict for alarm in found.alarms)
    assert not any("no alarm was raised by it" in reason for reason in found.reasons)


@pytest.mark.parametrize("onset_s", [20.0, 45.0, 70.0])
@pytest.mark.parametrize("channel", by_day(SIX))
def test_a_sign_that_turns_on_the_way_is_no_wrong_sign(channel, onset_s):
    broken = gb.inject(flight(), gb.SignFlip(channel=channel, onset_s=onset_s))
    assert cause_of([broken]) == []


def test_a_channel_that_stands_still_where_watched_is_never_clear_there(tmp_path):
    slow = flight()
    held = np.where((slow.time_s > 60.0) & (slow.time_s < 62.0), slow["psi"][1500], slow["psi"])
    found = watched(slow.replace("psi", held), tmp_path)
    assert {found.timeline.at(name, 61.0).state for name in ("r", "psi")} <= {State.FAILED, State.NOT_JUDGED}
    stuck = np.where((slow.time_s > 20.0) & (slow.time_s < 22.0), slow["q"][500], slow["q"])
    found = watched(slow.replace("q", stuck), tmp_path)
    assert (found.outcome, found.watches) == (Outcome.FAILED, ())
    assert [(sensor, round(span.start_s)) for sensor, span in found.verdict.failed] == [("q", 20)]
    assert "in the part to learn from: q stays at" in found.reasons[0]


def test_what_nothing_explains_isnt_watched_and_what_was_tried_is_said(tmp_path):
    random = np.random.default_rng(1)
    noise = np.convolve(random.standard_normal(len(flight()) + 20), np.hanning(21), mode="valid")
    found = watched(flight().replace("r", 5.0 * noise), tmp_path)
    assert (found.outcome, found.watches, found.check.causes) == (Outcome.UNKNOWN, (), ())
    assert "of r's slow motion is explained" in found.reasons[0]
    assert "no cause was found that makes every gyro fit (tried: turned signs" in found.reasons[0]


def test_at_rest_nothing_shows_what_channels_are(tmp_path):
    found = watched(airliner("still", 90001, duration_s=30), tmp_path, healthy=[(0.0, 15.0)])
    assert found.outcome is Outcome.UNKNOWN
    assert found.check.causes == ()
    assert found.reasons[0] == "p moves too little, beside its noise, to show that it is what it is taken for"


@pytest.mark.nightly
def test_what_a_bank_that_isnt_kinematic_leaves_unchecked_is_said(tmp_path):
    bank = gb.load_bank("leave-one-out")
    found = watched(airliner("minute", 90001, duration_s=60), tmp_path, bank, healthy=[(0.0, 30.0)])
    assert found.check.causes == ()
    assert found.check.notes == (
        "self-check: that channels live, no more, for nothing says what its sensors should read: signs, units, axes, "
        "lags and the time base weren't tried",
    )


@pytest.mark.nightly
def test_a_bank_without_a_heading_is_checked_by_the_logs_heading_or_says_that_there_is_none(tmp_path):
    spec = {"inputs": ["p_turn"], "output": "p", "look_back_s": 0.1, "look_ahead_s": 0.1}
    bank = bank_of("p alone", {"suspects": ["p", "phi", "theta"], "residuals": [spec]})
    assert "psi" not in bank.channels
    found = watched(ALL["-p"].mutate(flight()), tmp_path, bank)
    assert (found.outcome, [cause.text for cause in found.check.causes]) == (
        Outcome.UNKNOWN,
        ["the sign of p is turned"],
    )
    found = watched(ALL["-psi"].mutate(flight()), tmp_path, bank, judge="p,phi,theta")  # it doesn't read psi
    assert (found.outcome, found.check.causes) == (Outcome.HEALTHY, ())
    for name, outcome in (("none", Outcome.HEALTHY), ("-p", Outcome.UNKNOWN)):
        found = watched(ALL[name].mutate(flight()).select(bank.channels), tmp_path, bank, judged=0.6)
        assert found.verdict.scope.sensors == ("p",)
        assert (found.outcome, found.check.causes) == (outcome, ())
        assert found.check.notes[0].startswith(
            "self-check: that channels live and that of p motion is explained, no more, for"
        )


@pytest.mark.parametrize("name", by_day([name for name, mutation in WRONG.items() if not mutation.dead], 4))
def test_what_is_undone_was_done(name):
    mutation, record = ALL[name], flight()
    again = undone(mutation.mutate(record), mutation.changes)
    lost = any(change.kind in ("late", "held") for change in mutation.changes)
    rows = slice(25, len(record) - 25)
    room = 3.0 if lost else 1e-9  # between samples a line is taken
    np.testing.assert_allclose(again.values[rows], record.values[rows], atol=room, rtol=1e-9)
    assert holds(mutation.changes, [mutation.mutate(record)])


def test_what_reads_as_well_as_it_is_or_in_three_ways_has_no_cause():
    sure = {"p": 0.9, "q": 0.9, "r": 0.9}

    def guess(score, *signs):
        return WiringGuess(
            changes=tuple(WiringChange(kind="sign", channels=(name,)) for name in signs), score=score, fits=sure
        )

    one, two, other = guess(-2.0, "p"), guess(-1.99, "q"), guess(-1.98, "r")
    wrong = [MUTATIONS["-p"].mutate(flight())]
    assert causes_among([one], wrong) == [one]
    assert causes_among([one, guess(-1.97)], wrong) == []  # no change reads as well
    assert causes_among([one, two, other], wrong) == []
    assert causes_among([replace(one, fits={**sure, "r": 0.55})], wrong) == []
    assert causes_among([one, replace(two, fits={**sure, "r": 0.59})], wrong) == []  # nor is one of a pair told alone


def test_mirrored_attitudes_tell_the_same_motion():
    for signs in (("phi", "psi", "p", "r"), ("theta", "psi", "q", "r")):
        mirrored = flight()
        for name in signs:
            mirrored = mirrored.replace(name, -mirrored[name])
        assert as_it_is([mirrored]).fits == pytest.approx(as_it_is([flight()]).fits, abs=1e-9)


def test_gaps_and_missing_samples_hide_no_cause():
    for cause in ("-q", "p, r swapped", "attitude 0.3 s late", "gyros in rad/s"):
        wrong = ALL[cause].mutate(flight())
        lost = np.random.default_rng(2).random(len(wrong)) < 0.01
        wrong = wrong.replace("phi", np.where(lost, np.nan, wrong["phi"]))
        parts = [wrong.between(0.0, 25.0), wrong.between(30.0, 52.0), wrong.between(60.0, 75.0)]
        (found,) = cause_of(parts)
        assert is_cause(ALL[cause], found.changes)


def test_a_channel_that_is_never_there_or_hardly_has_no_cause():
    for there in (0, 15):
        lost = np.where(np.arange(len(flight())) < there, flight()["psi"], np.nan)
        assert guesses([flight().replace("psi", lost)]) == []
    assert guesses([]) == cause_of([]) == []
    still = gb.Record(np.zeros((500, 6)), channels=SIX, sample_period_s=0.04)
    assert guesses([still]) == []


@pytest.mark.nightly
def test_a_log_sampled_faster_has_the_same_cause():
    fast = gb.measure(gb.fly(excitation="multisine+turbulence", duration_s=40.0, seed=90004), noise="t2", seed=90004)
    for cause in ("none", "-theta", "psi 0.5 s late", "gyros 0.3 s late"):
        found = cause_of([mutated(fast, ALL[cause].changes)])
        assert [is_cause(ALL[cause], guess.changes) for guess in found] == ([] if cause == "none" else [True])


@pytest.mark.nightly
def test_the_command_tells_the_cause_and_what_to_type(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gb.write_log(ALL["-q"].mutate(flight()), tmp_path / "log.csv")
    options = ("monitor", "log.csv", "--detector", "C", "--healthy", "0:40")
    code, out, err = cli(*options, "--details")
    assert (code, err) == (3, "")
    assert "bank C: not calibrated, nothing is watched" in out
    assert all(f"\n{sensor:8}not judged  the sign of q is turned\n" in out for sensor in SIX)
    assert out.startswith("Cannot tell: the sign of q is turned.\n")
    assert "Next         Add --map q=-q_deg_s:deg/s" in out
    assert cli(*options, "--map", "q=-q_deg_s:deg/s", "-q") == (0, "", "")
    code, out, err = cli(*options, "--json")
    told = json.loads(out)
    assert (code, told["exit_code"], told["outcome"]) == (3, 3, "unknown")
    assert told["self_check"]["passed"] is False
    assert told["self_check"]["causes"][0]["changes"] == [{"kind": "sign", "channels": ["q"], "size": 0.0}]
    assert told["self_check"]["causes"][0]["to_type"] == "--map q=-q_deg_s:deg/s"
    code, out, err = cli("calibrate", *options[1:], "--out", "l.json")
    to_type = "the sign of q is turned; type --map q=-q_deg_s:deg/s"
    assert (code, out, err) == (2, "", f"gtmbench: log.csv: nothing is learnt from it: {to_type}\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv"]


@pytest.mark.parametrize(("louder", "is_calm"), [(1.48, True), (1.52, False)])
def test_a_residual_of_slow_motion_is_calm_that_is_no_more_than_half_as_loud_again_as_usual(louder, is_calm):
    place = np.arange(4000) * 2.0 * np.pi / 500.0
    usual = SimpleNamespace(rms_residual=np.array([1.0]))
    monitor = SimpleNamespace(operators={"q": usual}, basis=SimpleNamespace(kinematic=("q",)))
    left, read = louder * 2.0**0.5 * np.sin(place), 2.0 * np.cos(place)
    assert _explained(monitor, "q", "watched", [left], [read]).is_calm == is_calm
    assert not _explained(monitor, "q", "identified", [left], [read]).is_calm
