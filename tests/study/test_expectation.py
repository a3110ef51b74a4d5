"""What scenarios expect of detectors: how it is stated, when a verdict differs, and what a run says then."""

import json
from xml.etree import ElementTree as ET

import pytest

import gtmbench as gb
from gtmbench.report.words.study import summary_lines
from gtmbench.study.fault_tables import Expectation, expectations
from gtmbench.study.trial import Trial
from tests.faults.test_several_faults import TEXT as SEVERAL
from tests.helpers.night import by_day
from tests.helpers.watching import scenario
from tests.study.test_score import alarm, judged, named, verdict

BASE = SEVERAL[: SEVERAL.index("[[faults.also]]")]


def expected(table, channel="p"):
    return expectations("faults, table 1", {"C": table}, channel)["C"]


def differences(found, **expectation):
    """Return where a verdict differs from what is expected."""
    trial = object.__new__(Trial)
    for name, value in {**vars(found), "expected": Expectation(**expectation)}.items():
        object.__setattr__(trial, name, value)
    return trial.unexpected


def test_what_is_stated_arrives():
    stated = {"detect_within_s": 2, "isolate_as": ["p", "phi"], "kind": "jam"}
    assert expected(stated) == Expectation(detect_within_s=2.0, isolate_as=("p", "phi"), kind="jam")
    assert expected({"undetectable_because": "it is small"}) == Expectation(undetectable_because="it is small")
    assert expectations("here", {}, "p") == {}


@pytest.mark.parametrize(
    ("stated", "channel", "meant"),
    [
        ("channel", "q", ("q",)),
        ("axis", "q", ("q", "theta")),
        ("axis", "psi", ("r", "psi")),
        ("axis", "tas", ("tas",)),
        (["channel", "q", "axis"], "q", ("q", "theta")),
        ("r", "q", ("r",)),
    ],
)
def test_a_sensor_may_be_meant_by_what_it_is_to_the_trial(stated, channel, meant):
    assert expected({"isolate_as": stated}, channel).isolate_as == meant


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"C": 5}, r"expect.C is 5; it must be a table, \[faults.expect.DETECTOR\]"),
        (5, "expect is 5; it must be a table"),
        ({"C": {}}, "expect.C expects nothing"),
        ({"C": {"detect_within": 1}}, "unknown key 'detect_within'; there are detect_within_s, isolate_as"),
        ({"C": {"detect_within_s": 0}}, "detect_within_s is 0; it must be a finite number greater than 0"),
        ({"C": {"isolate_as": "w"}}, "isolate_as: no sensor 'w'; there are p, q, r"),
        ({"C": {"isolate_as": []}}, "isolate_as is an empty list"),
        ({"C": {"isolate_as": [3]}}, "isolate_as: no sensor 3"),
        ({"C": {"kind": 3}}, "kind is 3; it must be a short text"),
        ({"C": {"undetectable_because": ""}}, "undetectable_because is ''; it must be a short text"),
        ({"C": {"undetectable_because": "x", "kind": "jam"}}, "undetectable_because and kind contradict each other"),
    ],
)
def test_what_cant_be_meant_is_refused_by_place_and_key(given, message):
    with pytest.raises(gb.InputError, match=f"^faults, table 1: .*{message}"):
        expectations("faults, table 1", given, "p")


RIGHT = [alarm(judged(14.0, "p", kind="drift"), time_s=12.0)]
OPEN = [alarm(judged(14.0, "p", "phi"), time_s=12.0)]


@pytest.mark.parametrize(
    ("found", "expectation", "differs"),
    [
        (RIGHT, {"detect_within_s": 2.0, "isolate_as": ("p",), "kind": "drift"}, []),
        (RIGHT, {"detect_within_s": 1.999}, ["alarm 2.00 s after the onset, expected within 1.999 s"]),
        (RIGHT, {"isolate_as": ("r",)}, ["p failed, expected r"]),
        (RIGHT, {"isolate_as": ("p", "phi")}, []),
        (RIGHT, {"kind": "jam", "isolate_as": ("q",)}, ["p failed, expected q", "kind drift, expected jam"]),
        (OPEN, {"isolate_as": ("p", "phi")}, []),
        (OPEN, {"isolate_as": ("p", "phi", "q")}, []),
        (OPEN, {"isolate_as": ("p",)}, ["undecided: p or phi, expected p"]),
        (OPEN, {"isolate_as": ("p", "q")}, ["undecided: p or phi, expected p or q"]),
        (OPEN, {"kind": "drift"}, ["kind not told, expected drift"]),
        ([12.0], {"isolate_as": ("p",)}, ["alarm, expected p"]),
        ([], {"detect_within_s": 2.0, "kind": "jam"}, ["missed, expected an alarm within 2 s"]),
        ([], {"isolate_as": ("p",)}, ["missed, expected an alarm"]),
        ([], {"undetectable_because": "it is small"}, []),
        ([9.0], {"undetectable_because": "it is small"}, []),
        (RIGHT, {"undetectable_because": "it is small"}, ["alarm 2.00 s after the onset, expected none (it is small)"]),
    ],
)
def test_a_verdict_differs_where_it_says_otherwise(found, expectation, differs):
    assert list(differences(named(found), **expectation)) == differs


def test_who_names_nobody_isolates_nothing():
    assert differences(verdict([12.0]), isolate_as=("p",)) == ("no sensor named, expected p",)
    assert differences(verdict([12.0]), detect_within_s=3.0) == ()


def still(record):
    """Alarm where p stands still; it goes by the name still."""
    stands = record["p"][1:] == record["p"][:-1]
    return record.time_s[1:][stands][:1]


def run(expect):
    return gb.run_study([scenario("mine", BASE + expect)], detectors=[still])


def test_a_run_holds_a_trial_against_what_is_expected_of_its_detector_only():
    (as_expected,) = run("[faults.expect.still]\ndetect_within_s = 0.5\n").trials
    assert (as_expected.expected, as_expected.unexpected) == (Expectation(detect_within_s=0.5), ())
    (others,) = run("[faults.expect.C]\nundetectable_because = 'it is deaf'\n").trials
    assert (others.expected, others.unexpected) == (None, ())
    assert (others.row()["expected"], others.row()["unexpected"]) == (None, [])


def test_the_summary_says_where_reality_differs():
    study = run("[faults.expect.still]\nundetectable_because = 'it is deaf'\n")
    lines = summary_lines(study)
    assert "expectations met: 0 of 1" in lines
    (told,) = [line for line in lines if line.startswith("not as expected: ")]
    assert told == "not as expected: jam of p: alarm 0.00 s after the onset, expected none (it is deaf)"
    assert not any("expect" in line for line in summary_lines(run("")))


@pytest.fixture
def detector(tmp_path):
    (tmp_path / "watch.py").write_text(
        "def still(record):\n    return record.time_s[1:][record['p'][1:] == record['p'][:-1]][:1]\n"
    )
    return "watch.py:still"


WRONG = "[faults.expect.still]\nundetectable_because = 'it is deaf'\n"
FAST = ("--no-figures", "--no-recording", "--force")


@pytest.mark.parametrize(
    ("expect", "code"), by_day([(WRONG, 1), ("[faults.expect.still]\ndetect_within_s = 1\n", 0), ("", 0)])
)
def test_strict_is_an_exit_code_where_a_trial_differs(cli, tmp_path, detector, expect, code):
    (tmp_path / "mine.toml").write_text(BASE + expect)
    assert cli("run", "mine.toml", "--detector", detector, *FAST)[0] == 0
    ended, out, err = cli("run", "mine.toml", "--detector", detector, *FAST, "--strict", "--json")
    printed = json.loads(out)
    assert (ended, err) == (code, "")
    written = json.loads((tmp_path / "study/results.json").read_text())
    assert {key: printed[key] for key in written} == written
    assert (printed["exit_code"], len(printed["findings"]), printed["out"]) == (code, code, "study")
    (still,) = printed["detectors"]
    assert (still["expected"], still["unexpected"]) == (int(bool(expect)), code)
    assert bool(printed["trials"][0]["unexpected"]) == bool(code)
    said = cli("run", "mine.toml", "--detector", detector, *FAST, "--strict")[1]
    assert ("--strict: the scenarios expect nothing of still" in said) == (not expect)
    assert ("expected none (it is deaf)" in (tmp_path / "study/trials.csv").read_text()) == bool(code)


def test_several_seeds_say_so_too(cli, tmp_path, detector):
    (tmp_path / "mine.toml").write_text(BASE + WRONG)
    given = ("run", "mine.toml", "--detector", detector, *FAST, "--seed", "1:2")
    code, out, _ = cli(*given, "--strict")
    assert code == 1
    assert "2 of 2 faults detected" in out
    assert "; 2 not as its scenario expects." in out
    assert "still: expectations met: 0 of 2" in out
    assert cli(*given, "--out", "again", "-q") == (0, "", "")
    assert json.loads((tmp_path / "again/results.json").read_text())["detectors"][0]["unexpected"] == 2


def test_a_check_says_it_and_fails_by_its_figures_only(cli, tmp_path, detector):
    (tmp_path / "mine.toml").write_text(BASE + WRONG)
    (tmp_path / "held.toml").write_text('scenarios = ["mine.toml"]\ndetector = "still"\n')
    given = ("check", "held.toml", "--detector", detector)
    assert cli(*given, "--update", "-q")[0] == 0
    code, out, _ = cli(*given, "--junit", "held.xml")
    assert code == 0
    told = "jam of p: alarm 0.00 s after the onset, expected none (it is deaf)"
    assert f"not as expected: mine: {told}" in out
    (said,) = ET.parse(tmp_path / "held.xml").getroot().iter("system-out")
    assert said.text == "not as expected: alarm 0.00 s after the onset, expected none (it is deaf)"
    assert json.loads(cli(*given, "--json")[1])["unexpected"] == [f"mine: {told}"]
