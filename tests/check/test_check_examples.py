"""Figures held against a baseline, by example."""

import math

from gtmbench.check.baseline import find_baseline, renewed
from gtmbench.check.check import changed_rows, regression_line
from gtmbench.check.compare import Compared, Pair, compare
from gtmbench.check.figures import FigureGroup, Tolerance, figures_of, parse_tolerance, rounded, trial_names
from gtmbench.study.run import run_study
from gtmbench.study.scenario import load_scenario


def test_regression_line():
    figure = Compared(
        group="drift of p",
        figure="delay_s",
        at="",
        was=91.55,
        now=97.2,
        low=-math.inf,
        high=93.381,
        unit="s",
        remark="",
        better=False,
        explained=False,
    )
    assert regression_line(figure) == "drift of p, delay: was 91.55, is 97.2, allowed up to 93.381 s"


def test_changed_rows():
    pairs = [
        Pair(
            group="healthy E(k) of r",
            figure="windows",
            at=f"window {i}",
            was=1.0,
            now=now,
            unit="deg/s",
            remark="",
            explained=False,
        )
        for i, now in enumerate([1.0, 1.5, 4.0])
    ]
    assert changed_rows(pairs) == [["healthy E(k) of r, window 2, max (2 of 3 changed)", "1", "4", "deg/s"]]


def test_compare():
    was = {"score": {"E(k)": {"threshold": 6.0}}}
    now = FigureGroup(kind="score", name="E(k)", values={"threshold": 7.0}, unit="deg/s")
    (threshold,) = compare(was, [now], {"threshold": Tolerance(share=0.02)})
    assert (threshold.regressed, threshold.high) == (True, 6.12)


def test_figures_of():
    groups = figures_of(run_study([load_scenario("jam")]))
    assert [group.title for group in groups][:4] == [
        "healthy flight",
        "healthy residual of r",
        "healthy score E(k)",
        "jam of p",
    ]


def test_find_baseline():
    assert find_baseline("dissertation").name == "dissertation.toml"


def test_renewed():
    assert (
        renewed("[recorded]  # anew\nseed = 2  # mine", "[recorded]\nseed = 3")
        == "[recorded]  # anew\nseed = 3  # mine"
    )


def test_trial_names():
    assert trial_names([("drift", "drift", "p"), ("mine", "jam", "q"), ("mine", "jam", "q")]) == [
        "drift of p",
        "mine: jam of q",
        "mine: jam of q (2)",
    ]


def test_rounded():
    assert rounded(1.23456789) == 1.2346


def test_parse_tolerance():
    assert repr(parse_tolerance("tolerances.delay_s", ["2 %", 0.1])) == "Tolerance(share=0.02, absolute=0.1)"
