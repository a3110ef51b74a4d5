"""Half a minute of an airliner's manoeuvre makes a monitor: quiet on other manoeuvres, awake to faults."""

import json
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.errors import InputError
from gtmbench.log.watch import bank_between
from tests.helpers.airliner import MANOEUVRES, airliner
from tests.helpers.monitors import record
from tests.helpers.night import by_day
from tests.helpers.sealed import resealed

FREE = bank_between(["p", "beta", "ny"], ["r"])


@cache
def calibrated(*manoeuvres, rate_hz=25, duration_s=30, bank=None):
    records = [
        airliner(manoeuvre, 1 + i, rate_hz=rate_hz, duration_s=duration_s) for i, manoeuvre in enumerate(manoeuvres)
    ]
    return gb.calibrate(records, bank=bank or gb.load_bank("C"))


def alarmed(monitor, rate_hz=25, duration_s=30):
    """Return the manoeuvres, with noise of their own, that alarm."""
    held = {
        manoeuvre: airliner(manoeuvre, 10 + i, rate_hz=rate_hz, duration_s=duration_s)
        for i, manoeuvre in enumerate(MANOEUVRES)
    }
    return [manoeuvre for manoeuvre, flight in held.items() if bank_alarms(monitor, flight)]


MOVED = [("late",), ("pitch",), ("all",), ("pitch", "roll", "yaw"), ("roll",), ("yaw",), ("still",)]


@pytest.mark.parametrize("rate_hz", by_day([25, 50, 100]))
@pytest.mark.parametrize("manoeuvres", by_day(map(pytest.param, MOVED), 2), ids="+".join)
def test_other_manoeuvres_stay_quiet_whichever_axes_were_moved(manoeuvres, rate_hz):
    """The operator's error of the others lasts as long as the motion: it isn't averaged out as noise is."""
    assert alarmed(calibrated(*manoeuvres, rate_hz=rate_hz), rate_hz) == []


AIRLINER_FAULTS = [
    gb.Jam(channel="p", onset_s=14.0),
    gb.Jam(channel="q", onset_s=12.0),
    gb.Jam(channel="r", onset_s=14.0),
    gb.Drift(channel="p", onset_s=12.0, slope=0.3),
    gb.Drift(channel="q", onset_s=12.0, slope=-0.3),
    gb.Drift(channel="r", onset_s=12.0, slope=0.3),
    gb.Saturation(channel="p", onset_s=8.0, limit=2.0),
    gb.Saturation(channel="q", onset_s=8.0, limit=1.5),
    gb.Saturation(channel="r", onset_s=15.0, limit=2.0),
]


@pytest.mark.parametrize("fault", by_day(AIRLINER_FAULTS), ids=lambda fault: f"{type(fault).__name__} {fault.channel}")
def test_a_broken_gyro_is_found_and_named_on_a_manoeuvre_that_it_never_saw(fault):
    watch = gb.watch(calibrated("late"), gb.inject(airliner("all", 50), fault))
    assert [alarm.sensor for alarm in watch.faults] == [fault.channel]
    assert fault.onset_s < watch.alarm_s < fault.onset_s + 8.0
    after = watch.record.between(fault.onset_s, 30.0)
    assert np.nanmax(np.abs(after[fault.channel] - airliner("all", 50)[fault.channel][-len(after) :])) > 1.0


@pytest.mark.nightly
@pytest.mark.parametrize("rate_hz", by_day([50, 100]))
def test_a_drift_is_found_at_other_rates(rate_hz):
    broken = gb.inject(airliner("all", 50, rate_hz=rate_hz), gb.Drift(channel="r", onset_s=12.0, slope=0.5))
    assert [alarm.sensor for alarm in gb.watch(calibrated("late", rate_hz=rate_hz), broken).faults] == ["r"]


@pytest.mark.nightly
def test_free_operators_stay_quiet_and_find_what_is_large():
    monitor = calibrated("all", duration_s=60, bank=FREE)
    assert alarmed(monitor, duration_s=60) == []
    flight = airliner("late", 50, duration_s=60)
    (alarm,) = gb.watch(monitor, gb.inject(flight, gb.Drift(channel="r", onset_s=30.0, slope=1.0))).faults
    assert alarm.time_s > 30.0
    assert set(alarm.last.candidates) == {"r", "p", "beta", "ny"}  # nothing tells which


def spread(monitor, manoeuvre):
    """Return, of every residual, the spread at rest and the greatest."""
    widening = gb.watch(monitor, airliner(manoeuvre, 20)).widening
    return {output: (np.median(white[:50]), white.max()) for output, white in widening.items()}


def test_the_spread_is_one_in_motion_that_was_seen_and_large_in_what_nobody_saw():
    pitch, every = spread(calibrated("pitch"), "roll"), spread(calibrated("all"), "roll")
    assert all(rest < 1.1 for rest, _ in (*pitch.values(), *every.values()))
    assert pitch["p"][1] > 5.0  # nobody had rolled
    assert every["p"][1] < 1.5
    assert spread(calibrated("pitch"), "pitch")["q"][1] < 1.5


@pytest.mark.nightly
def test_a_shared_minimum_of_five_minutes_is_calibrated_on_without_doubt():
    records = [record(6000, seed=seed) for seed in (1, 2, 3)]  # two minutes each
    assert gb.calibrate(records, bank=gb.load_bank("C")).uncertainties == {}
    little = gb.calibrate(records[:2], bank=gb.load_bank("C"))
    assert set(little.uncertainties) == {"p", "q", "r"}
    assert gb.watch(little, records[2]).widening.keys() == {"p", "q", "r"}
    forced = gb.calibrate(records, bank=gb.load_bank("C"), estimator=gb.Bayesian())
    assert set(forced.uncertainties) == {"p", "q", "r"}
    assert forced.provenance["identification_hours"] == forced.provenance["threshold_hours"] == pytest.approx(0.1)
    least_squares = gb.calibrate(records[:2], bank=gb.load_bank("C"), estimator=gb.LeastSquares())
    assert least_squares.uncertainties == {}
    assert least_squares.provenance["identification_hours"] == pytest.approx(1.0 / 30.0)


@pytest.mark.nightly
def test_the_gtm_at_100_hz_too():
    flights = [gb.measure(gb.fly("gtm", "multisine", 48, seed), noise="t2", seed=seed) for seed in (1, 2)]
    monitor = gb.calibrate(flights[0], bank=gb.load_bank("C"))
    assert bank_alarms(monitor, flights[1]) == []
    broken = gb.inject(flights[1], gb.Jam(channel="q", onset_s=20.0))
    assert [alarm.sensor for alarm in gb.watch(monitor, broken).faults] == ["q"]


@pytest.mark.nightly
def test_a_monitor_that_was_saved_judges_bit_for_bit_alike(tmp_path):
    monitor = calibrated("pitch")
    gb.save_monitor(monitor, tmp_path / "m.json")
    again = gb.load_monitor(tmp_path / "m.json")
    flight = gb.inject(airliner("all", 3), gb.Drift(channel="p", onset_s=10.0, slope=0.5))
    watch, other = gb.watch(monitor, flight), gb.watch(again, flight)
    assert repr(watch.alarms) == repr(other.alarms) != "()"
    for output, score in watch.scores.items():
        assert score.values.tobytes() == other.scores[output].values.tobytes()
        assert watch.widening[output].tobytes() == other.widening[output].tobytes()


def test_a_file_that_says_doubt_is_read_and_saved_with_the_word_of_now(tmp_path):
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    gb.save_monitor(calibrated("pitch"), new)
    old.write_text(json.dumps(resealed(json.loads(new.read_text().replace('"uncertainty"', '"doubt"')))))
    assert old.read_bytes() != new.read_bytes()
    gb.save_monitor(gb.load_monitor(old), tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == new.read_bytes()
    both = json.loads(new.read_text())
    both["figures"]["residuals"]["p"]["doubt"] = None
    old.write_text(json.dumps(resealed(both)))
    with pytest.raises(InputError, match="unknown key 'doubt'"):
        gb.load_monitor(old)


HOSTILE = {
    "an uncertainty that is no table": (lambda _: [1.0], "residuals.p.uncertainty is"),
    "no root": (lambda given: {key: given[key] for key in ("raw", "white")}, "key 'root' is missing"),
    "one key more": (lambda given: {**given, "grey": 1.0}, "unknown key 'grey'"),
    "negative": (lambda given: {**given, "raw": -1.0}, "uncertainty.raw is -1"),
    "a word": (lambda given: {**given, "white": "much"}, "uncertainty.white is 'much'"),
    "no rows": (lambda given: {**given, "root": []}, "it must be a square table"),
    "too few rows": (lambda given: {**given, "root": [[1.0]]}, "uncertainty.root has 1 rows; the operator has 5"),
    "not square": (lambda given: {**given, "root": [[1.0] * 4] * 5}, "uncertainty.root holds a list of 4 where 5"),
    "a flag": (lambda uncertainty: {**uncertainty, "root": [[True] * 5] * 5}, "uncertainty.root is True"),
}


@pytest.mark.parametrize(("change", "words"), HOSTILE.values(), ids=HOSTILE)
def test_an_uncertainty_that_is_none_is_refused_by_name(change, words, tmp_path):
    gb.save_monitor(calibrated("pitch"), tmp_path / "m.json")
    document = json.loads((tmp_path / "m.json").read_text())
    saved = document["figures"]["residuals"]["p"]
    saved["uncertainty"] = change(saved["uncertainty"])
    (tmp_path / "m.json").write_text(json.dumps(resealed(document)))
    with pytest.raises(InputError, match=words):
        gb.load_monitor(tmp_path / "m.json")


def test_records_calibrate_alike_wherever_their_clock_begins_and_in_any_unit_of_a_free_input():
    flight = airliner("late", 1)
    later = gb.Record(flight.values, channels=flight.channels, sample_period_s=0.04, start_s=5000.0)
    scaled = flight.replace("ny", 1000.0 * flight["ny"])
    held = airliner("all", 2)
    values = gb.watch(gb.calibrate(flight, bank=FREE), held).scores["r"].values
    for given, judged in ((later, held), (scaled, held.replace("ny", 1000.0 * held["ny"]))):
        other = gb.watch(gb.calibrate(given, bank=FREE), judged).scores["r"].values
        np.testing.assert_allclose(other, values, rtol=1e-4)


def gappy(every):
    flight = airliner("all", 1)
    return flight.replace("p", np.where(np.arange(len(flight)) % every == 0, np.nan, flight["p"]))


@pytest.mark.parametrize(
    ("records", "words"),
    [
        ([airliner("all").between(0.0, 3.0)], r"a healthy record of 3.04 s is too short to calibrate on"),
        ([airliner("all"), airliner("all").between(0.0, 3.0)], r"3.04 s is too short"),
        ([airliner("all").replace("phi", np.zeros(751)).replace("psi", np.zeros(751))], "channel 'p_att' is constant"),
        (
            [airliner("all").replace("q", np.full(751, np.nan))],
            "751 samples are too few for windows of 5 without a missing one of q",
        ),
        ([gappy(4)], "751 samples are too few for windows of 5 without a missing one of p"),
        ([gappy(9)], r"% of the residual of p is missing, for every missing sample takes those around it along"),
    ],
    ids=["short", "one of them short", "at rest", "not there", "no window", "hardly a window"],
)
def test_what_cant_be_calibrated_on_is_refused_in_words(records, words):
    with pytest.raises(InputError, match=words):
        gb.calibrate(records, bank=gb.load_bank("C"), estimator=gb.Bayesian())


def test_an_attitude_that_moves_in_one_stretch_only_will_do():
    flight = airliner("yaw", 1)
    time_s = flight.time_s
    for angle in ("phi", "theta", "psi"):  # as a coarse log has it: at rest, not a digit changes
        moving = (time_s > 13.0) & (time_s < 17.0)
        flight = flight.replace(angle, np.where(moving, flight[angle], flight[angle][0]))
    assert set(gb.calibrate(flight, bank=gb.load_bank("C")).uncertainties) == {"p", "q", "r"}


@pytest.mark.parametrize(
    "missing", by_day([[("beta", 0, 60), ("p", 490, 500), ("phi", 499, 520)], [("phi", 460, 495)], []])
)
@pytest.mark.parametrize("bank", [None, FREE], ids=["C", "free"])
def test_scores_stand_on_the_record_up_to_the_time_they_are_known_at(bank, missing):
    monitor, flight = calibrated("late", bank=bank), airliner("all", 4)
    for channel, start, stop in missing:
        values = np.array(flight[channel])
        values[start:stop] = np.nan
        flight = flight.replace(channel, values)
    whole = gb.watch(monitor, flight).scores
    for cut_s in (18.6, 18.68, 19.88, 20.0, 20.12, 20.2):
        for output, score in gb.watch(monitor, flight.between(0.0, cut_s)).scores.items():
            known = score.known_s <= cut_s
            assert np.isfinite(score.values[known]).sum() > 280
            np.testing.assert_allclose(score.values[known], whole[output].values[: len(known)][known], rtol=1e-9)
