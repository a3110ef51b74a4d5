"""What a bank is identified on: no resets, no ground, no wrong attitude; and never so little that motion is gone."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.bank import load_bank
from gtmbench.detectors.bank_detector import BankDetector
from gtmbench.intake.events import Event, EventKind
from gtmbench.intake.flight_log import FlightLog
from gtmbench.log.learning import undisturbed as module
from gtmbench.log.learning.undisturbed import (
    GROUND,
    RESET,
    RESIDUAL,
    LeftOut,
    Stretches,
    healthy_stretches,
    ratios,
    undisturbed,
)
from gtmbench.log.watch import watch_log
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.log import log_report
from gtmbench.study.healthy_records import logged_records
from gtmbench.testing.shared_flights import fly_once
from gtmbench.verdict.verdict import Outcome

NEEDED = ("p", "q", "r", "phi", "theta", "psi")
C = BankDetector(bank=load_bank("C"))


@pytest.fixture(scope="module")
def flight():
    truth = fly_once(duration_s=120.0, seed=7)
    return gb.measure(truth, noise="t2", seed=7).select(NEEDED)


@pytest.fixture(scope="module")
def log(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "flight.csv"
    gb.write_log(flight, path)
    return gb.open_log(path, needs=NEEDED, rate_hz=50)


def happened(kind, time_s):
    return Event(kind=kind, time_s=time_s, text="")


def taken(log, records=None):
    records = tuple(log.segments if records is None else records)
    return undisturbed(C, Stretches(records=records, logs=(log,) * len(records)))


def spans(stretches, why):
    return [each.span for each in stretches.left_out if each.why == why]


def there(record, start_s, end_s):
    return np.isfinite(record.between(start_s, end_s).values)


def turned(record, channel, start_s, end_s, by):
    """An angle that reads otherwise for a while: two steps, nothing turned."""
    values = record[channel] + by * ((record.time_s >= start_s) & (record.time_s < end_s))
    return record.replace(channel, values)


def test_of_a_healthy_flight_every_sample_is_identified_on(log):
    assert taken(log).records == log.segments


def test_what_is_about_a_reset_is_missing_and_nothing_else(log):
    told = replace(log, events=(happened(EventKind.RESET, 40.0),))
    (record,) = taken(told).records
    assert not there(record, 37.52, 42.48).any()
    assert there(record, record.start_s, 37.48).all()
    assert there(record, 42.52, record.end_s).all()
    assert (record.start_s, record.end_s) == (log.segments[0].start_s, log.segments[0].end_s)


def test_what_is_on_the_ground_is_left_out_where_enough_flight_is_left(log):
    told = replace(log, events=(happened(EventKind.TAKEOFF, 15.0), happened(EventKind.TOUCHDOWN, 110.0)))
    found = taken(told)
    assert spans(found, GROUND) == [(log.segments[0].start_s, 15.0), (pytest.approx(107.5), log.segments[0].end_s)]
    (record,) = found.records
    assert record.start_s > 15.0
    assert record.end_s < 107.5


def test_an_attitude_that_is_set_anew_without_a_word_is_found_by_its_residual(log):
    broken = turned(log.segments[0], "psi", 60.0, 61.0, 8.0)
    found = taken(log, [broken])
    assert {each.why for each in found.left_out} == {RESIDUAL}
    left = [(start_s, end_s) for start_s, end_s in spans(found, RESIDUAL)]
    assert any(start_s <= 60.0 <= end_s for start_s, end_s in left)
    assert all(start_s < 64.0 and end_s > 57.0 for start_s, end_s in left)


def test_a_manoeuvre_whose_residual_is_as_large_as_its_motion_has_it_stays(log):
    """A gyro's scale that is 4 % off leaves 4 % of any motion: most where it moves most."""
    record = log.segments[0]
    for name in ("p", "q", "r"):
        record = record.replace(name, 1.04 * record[name])
    assert taken(log, [record]).left_out == ()


def test_motion_isnt_what_is_left_out():
    quiet = np.full((20, 1), 0.1)
    calm = np.full(20, 1.0)
    assert ratios(quiet, calm) == pytest.approx(1.0)
    moved = calm.copy()
    moved[7] = 30.0
    proportional = quiet.copy()
    proportional[7] = 3.0
    assert ratios(proportional, moved)[7] == pytest.approx(1.0)
    proportional[7] = 30.0
    assert ratios(proportional, moved)[7] == pytest.approx(10.0)
    unmoved = quiet.copy()
    unmoved[7] = 3.0
    assert ratios(unmoved, calm)[7] == pytest.approx(30.0)


def test_another_detector_keeps_everything(log):
    told = replace(log, events=(happened(EventKind.RESET, 40.0),))
    others = gb.find_detector("paper")
    whole = Stretches(records=told.segments, logs=(told,))
    assert undisturbed(others, whole) is whole


@pytest.fixture(scope="module")
def watched(log, tmp_path_factory):
    """The same flight, watched: heading steps by 15 deg and back at 20 s, which nobody tells of."""
    folder = tmp_path_factory.mktemp("watched")
    for name, record in (("whole", log.segments[0]), ("reset", turned(log.segments[0], "psi", 20.0, 20.5, 15.0))):
        gb.write_log(record, folder / f"{name}.csv")
    return {name: watch_log(folder / f"{name}.csv", "C", healthy=[(0.0, 60.0)]) for name in ("whole", "reset")}


@pytest.mark.nightly
def test_a_residual_is_as_large_as_without_the_reset(watched):
    rms = {name: float(each.monitor.operators["r"].rms_residual[0]) for name, each in watched.items()}
    assert rms["reset"] == pytest.approx(rms["whole"], rel=0.1)
    assert watched["reset"].outcome is Outcome.HEALTHY


@pytest.mark.nightly
def test_what_was_left_out_is_said_shown_and_written(watched):
    reset = watched["reset"]
    (reason,) = [line for line in reset.reasons if "left out of identification" in line]
    assert reason in " ".join(log_report(reset))
    left = [each.span for each in reset.left_out]
    assert sum(end_s - start_s for start_s, end_s in left) <= 4.5
    assert any(start_s <= 20.0 <= end_s for start_s, end_s in left)
    table = json.loads(json.dumps(log_results(reset)))
    assert {row["log"] for row in table["left_out_of_identification"]} == {str(reset.log.path)}
    assert not watched["whole"].left_out


def test_calibrate_does_alike_and_says_so(log, tmp_path):
    gb.write_log(turned(log.segments[0], "psi", 60.0, 61.0, 15.0), tmp_path / "reset.csv")
    gb.write_log(log.segments[0], tmp_path / "whole.csv")
    records, origin = logged_records([tmp_path / "reset.csv"], C)
    assert all("left out of identification" in line for line in origin["left_out"])
    assert not any(record.start_s < 60.0 < record.end_s for record in records)
    records, origin = logged_records([tmp_path / "whole.csv"], C)
    assert "left_out" not in origin
    assert len(records) == 1


def test_a_log_of_the_same_name_elsewhere_keeps_its_samples(log, tmp_path):
    (tmp_path / "other").mkdir()
    gb.write_log(log.segments[0], tmp_path / "other" / log.path.name)
    other = gb.open_log(tmp_path / "other" / log.path.name, needs=NEEDED)
    told = replace(log, events=(happened(EventKind.RESET, 40.0),))
    found = undisturbed(C, Stretches(records=(*told.segments, *other.segments), logs=(told, other)))
    assert [bool(there(record, 37.6, 42.4).any()) for record in found.records] == [False, True]


def test_a_log_without_anything_to_identify_on_leaves_it_to_the_others(log):
    short = log.segments[0].between(10.0, 11.0)
    found, _ = healthy_stretches([(log, [short]), (log, log.segments)], NEEDED)
    assert [len(record) for record in found.records] == [len(log.segments[0])]
    with pytest.raises(gb.InputError, match="nothing that is healthy"):
        healthy_stretches([(log, [])], NEEDED)


def resting(*seconds, start_s=0.0, log="log.csv"):
    """Return stretches of a bank's channels, so long each, of a log, and the log."""
    records = []
    for each in seconds:
        values = np.random.default_rng(1).random((round(10 * each), 6))
        records.append(gb.Record(values, channels=NEEDED, sample_period_s=0.1, start_s=start_s))
        start_s = records[-1].end_s + 50.0
    log = FlightLog(path=Path(log), segments=tuple(records), remarks=(), method=())
    return Stretches(records=tuple(records), logs=(log,) * len(records)), log


@pytest.mark.parametrize(
    ("seconds", "kept"), [((100.0, 19.8), 1), ((100.0, 20.2), 2), ((20.0, 4.8), 1), ((20.0, 5.2), 2)]
)
def test_a_stretch_is_a_fifth_of_the_longest_or_five_seconds_at_least(seconds, kept):
    stretches, log = resting(*seconds)
    found, told = healthy_stretches([(log, stretches.records)], NEEDED)
    assert (len(found.records), len(told)) == (kept, 2 - kept)


@pytest.mark.parametrize(
    ("seconds", "spans", "left_out"),
    [
        (120.0, [(10.0, 49.8)], 1),  # two thirds of the samples stay
        (120.0, [(10.0, 50.3)], 0),
        (20.0, [(10.0, 14.8)], 1),  # and fifteen seconds
        (20.0, [(10.0, 15.2)], 0),
        (120.0, [(10.0, 12.0), (30.0, 33.0)], 2),  # and half of the motion, of which each has a quarter
        (120.0, [(10.0, 12.0), (30.0, 33.0), (60.0, 63.0)], 2),
    ],
)
def test_of_blocks_whose_residuals_stand_out_no_more_are_left_out_than_a_bank_can_spare(
    seconds, spans, left_out, monkeypatch
):
    asked = []

    def beyond(stretches, _, times):
        asked.append(times)
        return [(LeftOut(log=stretches.logs[0].path, span=span, why=RESIDUAL), 0.25) for span in spans]

    monkeypatch.setattr(module, "_beyond", beyond)
    assert len(undisturbed(C, resting(seconds)[0]).left_out) == left_out
    assert asked == [6.0]


@pytest.mark.parametrize(("until_s", "left_out"), [(24.8, 1), (25.3, 0)])
def test_what_stood_on_the_ground_is_left_out_where_a_minute_of_flight_is_left(until_s, left_out, monkeypatch):
    monkeypatch.setattr(module, "_beyond", lambda *_: [])
    stretches, log = resting(85.0)
    told = replace(log, events=(happened(EventKind.TAKEOFF, until_s),))
    assert len(undisturbed(C, replace(stretches, logs=(told,))).left_out) == left_out


def test_spans_that_a_quarter_of_a_second_parts_are_told_as_one():
    left = [LeftOut(log=Path("log.csv"), span=span, why=RESET) for span in ((0.0, 1.0), (1.24, 2.0), (2.26, 3.0))]
    (line,) = replace(resting(20.0)[0], left_out=tuple(left)).reasons
    assert line.startswith("log.csv: 0.0..2.0 s, 2.3..3.0 s left out")


@pytest.mark.parametrize(("there", "dense"), [(0.66, False), (0.67, True)])
def test_of_a_stretch_two_thirds_have_to_be_there(there, dense):
    values = np.where(np.arange(1000)[:, np.newaxis] % 100 < 100 * there, np.ones(6), np.nan)
    record = gb.Record(values, channels=NEEDED, sample_period_s=0.1)
    assert Stretches(records=(record,), logs=(resting(20.0)[1],)).dense == dense


def test_the_third_of_the_blocks_whose_motion_is_nearest_says_what_is_usual():
    """Of thirty ten: five that leave 1 and five that leave 2, however much the others leave."""
    left = np.concatenate([[6.0], np.full(5, 1.0), np.full(5, 2.0), np.full(19, 9.0)])[:, np.newaxis]
    assert ratios(left, 1.0 + 1e-6 * np.arange(30.0))[0] == pytest.approx(4.0, rel=1e-3)
