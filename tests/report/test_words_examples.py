"""What words, tables and pages of the report say, by example."""

import math

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.bank import load_bank
from gtmbench.detectors.bank.detectability import isolability
from gtmbench.engine.explanation import Explanation
from gtmbench.engine.finding import Finding
from gtmbench.engine.relation import Effect
from gtmbench.intake.estimator_words import RATIO, EstimatorWord
from gtmbench.intake.events import Event
from gtmbench.intake.published_failures import Injection
from gtmbench.log.judging.certificate import Certificate, SmallestSeen
from gtmbench.log.truth.autopilot_messages import Beside
from gtmbench.report.words.found import certificate_text, chances_text, size_text
from gtmbench.report.words.judgement import estimate_text
from gtmbench.report.words.monitor import isolation_lines
from gtmbench.report.words.others import beside_text, estimator_lines, injection_text
from gtmbench.report.words.study import severity_unit, severity_words
from gtmbench.report.words.units import (
    capitalised,
    counted,
    duration_text,
    or_dash,
    per_second,
    percent_text,
    round_times,
    round_values,
    time_text,
    with_unit,
)
from gtmbench.study.scores.curves import Smallest
from gtmbench.study.scores.intervals import Estimate, Share


def test_beside_text():
    word = Event(kind="complaint", time_s=12.5, text="gyro 1 isn't healthy", about="gyro", number=1)
    assert beside_text(Beside(alarm=Alarm(number=0, time_s=11.0, onset_s=10.0, source="q"), word=word)) == (
        "beside our alarm at 11.00 s: 'gyro 1 isn't healthy' at 12.50 s, 1.50 s later"
    )


def test_certificate_text():
    row = SmallestSeen(sensor="r", kind="bias", size=0.8412, share=0.9, within_s=10.0)
    assert certificate_text(Certificate(rows=(row,), watched_s=134.2)) == (
        "A bias above r 0.84 deg/s would have been detected within 10 s (at 90 % of start times)."
    )


def test_size_text():
    drift = SmallestSeen(sensor="p", kind="drift", size=0.02636, share=0.9, within_s=20.0)
    assert (size_text(drift, drift.size), size_text(drift, None)) == ("0.026 deg/s²", "-")


def test_chances_text():
    bias = (Explanation(suspect="q", kind="bias", effect=lambda _: Effect()), 0.0)
    told = {"first": 0, "last": 9, "onset_s": 4.0, "end_s": 9.0, "onset_range_s": (3.0, 5.0), "evidence": 50.0}
    chances = (("q", "bias", 0.93), ("theta", "drift", 0.07))
    assert (
        chances_text(Finding(ranked=(bias,), size=2.0, interval=(1.9, 2.1), chances=chances, **told))
        == "bias of q 93 %, drift of theta 7 %"
    )


def test_estimate_text():
    known = {"slope": (0.0498, 0.05002), "onset_s": (299.7, 300.12)}
    assert (
        estimate_text("drift", {"slope": 0.04991, "onset_s": 299.91}, known, "deg/s")
        == "0.0499 ± 0.0001 deg/s², from 299.9 ± 0.2 s"
    )
    assert estimate_text("lag", {"lag_s": 1.0}, {"lag_s": (1.0, math.inf)}, "deg") == "at least 1 s"
    assert estimate_text("stuck", {"value": 0.0}, {}, "deg") == "at 0 deg"


def test_estimator_lines():
    time_s = np.array([0.0, 1.0, 2.0])
    ratios = EstimatorWord(
        quantity=RATIO, of="magnetometer", columns=(), time_s=time_s, values=np.array([0.2, 1.5, 0.4])
    )
    assert estimator_lines([ratios]) == [
        "the estimator's tests, which reject above 1: magnetometer 1.5 at most, above 1 from 1.0 s"
    ]


def test_severity_words():
    some = {"fault": "drift", "channel": "p", "parameter": "slope", "share_of": None}
    some |= {"found": Share(hits=9, of=10, low=0.5, high=1.0), "mildest": 0.01, "severest": 1.0}
    assert (
        severity_words(Smallest(**some, severity=Estimate(value=0.123, low=0.1, high=math.inf)))
        == "0.123 [0.1, over 1]"
    )
    assert severity_words(Smallest(**some, severity=Estimate(value=math.inf))) == "over 1"


def test_severity_unit():
    some = {"fault": "drift", "channel": "p", "parameter": "slope", "mildest": 0.01, "severest": 1.0}
    some |= {"found": Share(hits=1, of=1, low=0.0, high=1.0), "severity": Estimate(value=0.1)}
    assert (severity_unit(Smallest(**some, share_of=None)), severity_unit(Smallest(**some, share_of="slew"))) == (
        "deg/s²",
        "% of slew",
    )


def test_report_words():
    assert (
        injection_text(
            Injection(
                sensor="gyro",
                number=2,
                channels=("q",),
                kind="bias",
                size=5.73,
                unit="deg/s",
                onset_s=60.0,
                end_s=90.0,
                text="SIM_GYR2_BIAS_Y = 0.1",
            )
        )
        == "q of gyro 2: bias 5.73 deg/s from 60.00 to 90.00 s"
    )
    assert list(isolation_lines(isolability(load_bank("C")))) == [
        ("isolable by which residuals rise: p (p), q (q), r (r), phi, theta and psi (p, q and r)"),
        ("isolable only by how they rise: p, q and r from phi, theta and psi; phi, theta and psi from each other"),
    ]


def test_report_words_units():
    assert (capitalised("no GPS"), capitalised("")) == ("No GPS", "")
    assert (per_second("deg/s"), per_second("g"), per_second("")) == ("deg/s²", "g/s", "per s")
    assert (with_unit("p", "deg/s"), with_unit("strain_3", "")) == ("p (deg/s)", "strain_3")
    assert (percent_text(0.873), percent_text(0.9987)) == ("87 %", "over 99 %")
    assert (duration_text(2.0), duration_text(0.21), duration_text(0.0083)) == ("2.00 h", "0.21 h", "29.9 s")
    assert (or_dash(0.125, ".2f"), or_dash(None, ".2f")) == ("0.12", "-")
    assert (counted(1, "false alarm"), counted(0, "false alarm")) == ("1 false alarm", "0 false alarms")
    assert (time_text(60.04), time_text(5025.26)) == ("60.0 s", "5025.3 s (1:23:45)")
    assert round_values((-0.31, 0.28)) == [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2]
    assert round_times((0.0, 60.0)) == [(0.0, "0"), (20.0, "20"), (40.0, "40"), (60.0, "60")]
    assert [name for _, name in round_times((600.0, 7300.0))] == ["0:30:00", "1:00:00", "1:30:00", "2:00:00"]
