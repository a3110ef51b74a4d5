"""Small parts of tables, figures and pages, by example."""

import numpy as np
import pandas as pd

from gtmbench.faults.kinds.additive import Drift
from gtmbench.intake.events import Event
from gtmbench.method.driven_attitude import Origin
from gtmbench.report.campaign import _time
from gtmbench.report.figures.study import _safe
from gtmbench.report.fleet import counts_text, exit_code, words_text
from gtmbench.report.fleet_report import page_name
from gtmbench.report.markup import markdown
from gtmbench.report.recording.entities import _sent
from gtmbench.report.style import colours, strokes
from gtmbench.report.tables.results import _headers, named
from gtmbench.report.tables.scores import range_cell
from gtmbench.report.words.judgement import parameter_units, units_of
from gtmbench.report.words.log import attitude_lines
from gtmbench.report.words.study import _percent, rate_words
from gtmbench.report.words.timeline import cut, factors_text
from gtmbench.study.scores.intervals import Rate


def test_report():
    assert (_time(0.004), _time(0.3), _time(30.0), _time(400.0)) == ("14 s", "18 min", "30 h", "17 days")
    assert page_name("monday/flight 1.csv") == "flight_1.csv-99606b.html"
    assert strokes(["C", "B"])["B"] == {"color": "#d55e00", "linestyle": "--", "marker": "s"}
    assert len({(each["color"], each["linestyle"]) for each in strokes(map(str, range(28))).values()}) == 28
    assert colours(["p", "flow", "p"]) == {"p": "#1f77b4", "flow": "#17a2b8"}


def test_report_figures():
    assert (_safe("C (2)"), _safe("../odd")) == ("C_2", "odd")


def test_report_fleet():
    assert (
        words_text([Event(kind="complaint", time_s=12.5, text="gyro 1 isn't healthy", about="gyro", number=1)])
        == "gyro 1 isn't healthy, 12.5 s"
    )
    assert counts_text(["healthy", "failed", "error", "healthy"]) == "4 logs: 1 failed, 1 not read, 2 no fault found"
    assert (exit_code([{"outcome": "healthy"}, {"outcome": "error"}]), exit_code([{"outcome": "error"}])) == (3, 2)


def test_report_recording():
    assert _sent(np.array([False, True, False, False, True, False])).tolist() == [False, True, True, False, True, False]


def test_report_tables():
    assert (
        markdown(pd.DataFrame([{"fault": "jam", "detected": 3}]))
        == "| fault | detected |\n| ----- | -------- |\n| jam   | 3        |"
    )
    assert (_headers("drift", "p"), _headers("oscillation", "nz")["amplitude"]) == (
        {"slope": "slope_deg_s2"},
        "amplitude_g",
    )
    assert named({"slope": 0.05}) == "slope=0.05"
    assert (range_cell((0.31, 0.334)).text, range_cell((8.0, float("inf"))).text) == ("0.31 to 0.33", "8.00 to missed")


def test_report_words():
    assert (_percent(0.4321), _percent(0.9987), _percent(1.0)) == ("43", "99.9", "100")
    assert rate_words(Rate(events=0, hours=3.0, low=0.0, high=1.23)) == "0 [0, 1.2]"
    assert units_of(Drift(channel="p", onset_s=300, slope=0.05)) == {"slope": "deg/s²"}
    assert (parameter_units("spikes", ["size", "rate_hz"], "deg/s"), parameter_units("jam", ["value"], "deg")) == (
        {"size": "deg/s", "rate_hz": "Hz"},
        {"value": "deg"},
    )
    assert attitude_lines(Origin(is_driven=False, why="as it was told")) == ["attitude: of its own (as it was told)"]
    assert (cut("clear for 140 of 180 s", 16), cut("clear", 16)) == ("clear for 140...", "clear")
    assert (factors_text((0.7, 1.3)), factors_text((0.6, 1.5)), factors_text((0.0, 2.0))) == (
        "a factor of 0.7",
        "a factor below 0.6 or above 1.5",
        "a factor of 0 or above 2",
    )
