"""Baselines as files: what is read is checked, what is written reads back, and what people wrote stays."""

import contextlib
import re
import tomllib
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.check.baseline import (
    TOLERATED,
    figures_text,
    new_baseline,
    read_reference,
    reference_of,
    renewed,
    write_figures,
)
from gtmbench.check.check import check, run_reference
from gtmbench.check.compare import pairs
from gtmbench.check.figures import KINDS, OF_LOGS, RULES, FigureGroup, rounded
from gtmbench.detectors.registry import find_detector
from gtmbench.files.shipped import shipped_baselines
from gtmbench.files.writing import LARGEST_TOML_BYTES
from gtmbench.study.scenario import load_scenario

HEALTHY = FigureGroup(kind="healthy", name="flight", values={"false_alarms": 0, "hours": 0.5})
NORM = FigureGroup(
    kind="score",
    name="E(k)",
    values={"threshold": 6.25, "margin": 1.5, "windows": (4.0, 3.5, float("nan"))},
    labels={"windows": ("window 25..35 s", "window 35..45 s", "window 45..50 s")},
    unit="deg/s",
)
JAM = FigureGroup(kind="trials", name="jam of p", values={"detected": True, "delay_s": 6.14, "peak_ratio": 5.0})


@cache
def text():
    """A baseline of the jam scenario without figures."""
    return new_baseline(Path("mine.toml"), scenarios=["jam"], detector=None)


def same(recorded, groups):
    return all(repr(pair.was) == repr(pair.now) for pair in pairs(recorded, groups))


def test_what_is_written_reads_back_and_is_the_same_bytes_each_time(tmp_path):
    path, groups = tmp_path / "mine.toml", [HEALTHY, NORM, JAM]
    write_figures(path, text(), seed=1, groups=groups)
    first = path.read_text()
    assert same(read_reference(path).recorded, groups)
    write_figures(path, first, seed=1, groups=groups)
    assert path.read_text() == first
    assert [entry.name for entry in tmp_path.iterdir()] == ["mine.toml"]


def test_a_new_baseline_states_everything_it_takes_for_granted(tmp_path):
    stated = tomllib.loads(text())
    assert stated["scenarios"] == ["jam"]
    assert stated["seed"] == 1
    of_monitors, of_logs = {"thresholds", "isolation_delay_s"}, {*OF_LOGS}
    assert set(stated["tolerances"]) == set(TOLERATED) - of_monitors - of_logs
    watched = tomllib.loads(new_baseline(tmp_path / "x.toml", scenarios=["jam"], detector="C"))
    assert set(watched["tolerances"]) == set(TOLERATED) - {"threshold"} - of_logs
    recorded = tomllib.loads(new_baseline(tmp_path / "x.toml", logs=[str(tmp_path / "logs")]))
    assert set(recorded["tolerances"]) == set(TOLERATED) & of_logs
    assert (recorded["logs"], recorded["detector"]) == (["logs"], "auto")
    assert watched["detector"] == "C"
    for name, tolerance in {**stated["tolerances"], **watched["tolerances"]}.items():
        assert tolerance == RULES[name].tolerance
    lines = text().splitlines()
    assert all("  # " in line for line in lines[lines.index("seed = 1") + 5 :] if line)
    path = tmp_path / "bare.toml"
    path.write_text('scenarios = ["jam"]\n')
    assert read_reference(path).tolerances == reference_of(path, stated).tolerances


EDITED = """\
seed = 1
scenarios = [
  "jam",  # the worst
]
[tolerances]
rms = "50 %"  # ours is noisy

[residual.r]
rms = 1.0
[recorded]  # found 2026-11-20
seed = 1

[healthy.flight]  # of the shop
false_alarms = 3  # see the ticket
hours = 0.4

# trials: jam of p is the customer's
[trials]
# slow since the filter
"jam of p" = { detected = true, delay_s = 9.0, peak_ratio = 5.0 }  # known
"jam of q" = { detected = true, delay_s = 9.0, peak_ratio = 5.0 }
"""


def test_comments_tolerances_and_order_survive_new_figures():
    new = renewed(EDITED, figures_text(1, [HEALTHY, NORM, JAM]))
    lines = new.splitlines()
    gone, kept = EDITED.split("[residual.r]\nrms = 1.0\n"), "[healthy.flight]  # of the shop\n"
    digests = re.compile(r'digest = "\w{64}"  # of the figures\nsettings = ""  # of what stands above\n')
    assert len(digests.findall(new)) == 1
    assert digests.sub("", new).startswith(gone[0] + gone[1].split(kept)[0] + kept)
    assert "false_alarms = 0  # see the ticket" in lines
    after = lines.index("# slow since the filter")
    assert lines[after + 1] == '"jam of p" = { detected = true, delay_s = 6.14, peak_ratio = 5.0 }  # known'
    assert "# trials: jam of p is the customer's" in lines
    table = tomllib.loads(new)
    assert "residual" not in table
    assert list(table["trials"]) == ["jam of p"]
    assert same(reference_of(Path("x.toml"), table).recorded, [HEALTHY, NORM, JAM])
    assert renewed(new, figures_text(1, [HEALTHY, NORM, JAM])) == new


NUMBERS = st.floats().map(rounded)
FIGURES = {
    "flag": st.booleans(),
    "count": st.integers(0, 2**31 - 1),
    "real": NUMBERS,
    "list": st.lists(NUMBERS, max_size=25).map(tuple),
}


@st.composite
def groups(draw):
    kind = draw(st.sampled_from(list(KINDS)))
    names = draw(st.lists(st.sampled_from(KINDS[kind][1]), min_size=1, unique=True))
    of = draw(
        st.text(st.characters(codec="utf-8"), min_size=1)
        if kind == "trials"
        else st.sampled_from(["r", "r q", "E(k)", "a.b", "ü"])
    )
    values = {name: draw(FIGURES[RULES[name].form]) for name in names}
    labels = {name: tuple("x" * len(value)) for name, value in values.items() if isinstance(value, tuple)}
    return FigureGroup(kind=kind, name=of, values=values, labels=labels)


@pytest.mark.nightly
@settings(max_examples=30)
@given(st.lists(groups(), max_size=3, unique_by=lambda group: (group.kind, group.name)))
def test_any_figures_of_any_scenario_read_back(several):
    """Names of trials are names of files: quotes, backslashes, control characters."""
    for before in (text(), EDITED):
        table = tomllib.loads(renewed(before, figures_text(3, several)))
        reference = reference_of(Path("x.toml"), table)
        assert same(reference.recorded, several)
        assert reference.recorded_seed == 3


def test_scenarios_and_monitors_are_found_from_the_baselines_folder(tmp_path, monkeypatch):
    (tmp_path / "ci").mkdir()
    (tmp_path / "shop").mkdir()
    monkeypatch.chdir(tmp_path)
    own = '[[faults]]\nkind = "jam"\nchannels = ["p"]\nonset_s = 300.0\n'
    (tmp_path / "shop/own.toml").write_text(own)
    path = tmp_path / "ci/mine.toml"
    path.write_text(new_baseline(Path("ci/mine.toml"), scenarios=["shop/own.toml", "jam"], detector="shop/m.json"))
    stated = tomllib.loads(path.read_text())
    assert stated["scenarios"] == ["../shop/own.toml", "jam"]
    assert stated["detector"] == "../shop/m.json"
    monkeypatch.chdir(tmp_path / "shop")
    reference = read_reference(path)
    assert [scenario.name for scenario in reference.scenarios] == ["own", "jam"]
    assert reference.trials == ["own: jam of p", "jam of p", "jam of q", "jam of r"]
    assert Path(reference.detector).resolve() == tmp_path / "shop/m.json"


@pytest.mark.parametrize("name", ["C", "dissertation", "limit check", "installed.one"])
def test_a_detectors_name_is_none_of_a_file(name, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(new_baseline(path, scenarios=["jam"], detector=name))
    assert tomllib.loads(path.read_text())["detector"] == read_reference(path).detector == name


BAD = {
    "no scenarios": ('scenarios = ["jam"]', "", "no scenarios given"),
    "scenarios aren't a list": ('["jam"]', '"jam"', "scenarios is 'jam'; it must be a list"),
    "no such scenario": ('["jam"]', '["jim"]', "no scenario '"),
    "unknown key": ("seed = 1\n#", "speed = 1\n#", "unknown key 'speed'; there are scenarios, seed"),
    "seed": ("seed = 1\n#", "seed = -1\n#", "seed is -1; it must be a whole number"),
    "detector": ('# detector = "monitor.json"', "detector = 3", "detector is 3; it must be"),
    "Python": ('# detector = "monitor.json"', 'detector = "mine.py:Mine"', "a baseline imports no Python; state the"),
    "unknown tolerance": ("\nrms =", "\nrmse =", r"unknown key 'rmse' in [tolerances]"),
    "tolerance": ('rms = "2 %"', 'rms = "2"', "tolerances.rms is '2'; give a share"),
    "a huge number": ("\nhours = 0.5", f"\nhours = {10**400}", "healthy.flight.hours is 1"),
    "a text for a number": ("margin = 1.5", 'margin = "x"', "score.E(k).margin is 'x'; it must be a finite number"),
    "a number for a list": ("windows = [\n  4.0, 3.5, nan,", "windows = [\n '4',", "score.E(k).windows[0] is '4'"),
    "a number for a flag": ("detected = true", "detected = 1", "trials.jam of p.detected is 1; it must be true or"),
    "a negative count": ("false_alarms = 0\nhours = 0.5", "false_alarms = -1", "false_alarms is -1"),
    "a strange figure": ("margin = 1.5", "margine = 1.5", r"unknown key 'margine' in [score.E(k)]"),
    "a number for a table": ("[healthy.flight]", "[healthy]", "healthy.false_alarms is 0; it must be a table"),
    "no TOML": ("[trials]", "<<<<<<< ours", "isn't a readable TOML file"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_baseline_is_refused_in_one_line_that_names_the_key(tmp_path, name):
    old, new, message = BAD[name]
    good = renewed(text(), figures_text(1, [HEALTHY, NORM, JAM]))
    assert good.count(old) == 1, old
    path = tmp_path / "mine.toml"
    path.write_text(good.replace(old, new))
    with pytest.raises(gb.InputError) as error:
        read_reference(path)
    assert message in str(error.value)
    assert str(path) in str(error.value)


def test_figures_of_another_run_are_refused_before_the_run(tmp_path):
    trials = [replace(JAM, name=f"jam of {channel}") for channel in "pqr"]
    path = tmp_path / "mine.toml"

    def refusal(before, seed, those):
        path.write_text(before if seed is None else renewed(before, figures_text(seed, those)))
        with pytest.raises(gb.InputError) as error:
            read_reference(path).check_recorded()
        return str(error.value)

    assert "it holds no figures yet; --update records them" in refusal(text(), None, [])
    assert "its figures are those of seed 2, and the seed is 1" in refusal(text(), 2, trials)
    assert "no figures of trial 'jam of r' yet" in refusal(text(), 1, trials[:2])
    assert "trial 'jam of x', which isn't there any more" in refusal(
        text(), 1, [*trials, replace(JAM, name="jam of x")]
    )
    write_figures(path, text(), seed=1, groups=trials)
    read_reference(path).check_recorded()


def test_figures_that_were_altered_are_refused_and_settings_that_were_edited_are_told(tmp_path):
    path = tmp_path / "mine.toml"
    trials = [replace(JAM, name=f"jam of {channel}") for channel in "pqr"]
    write_figures(path, text(), seed=1, groups=trials)
    whole = path.read_text()
    path.write_text(whole.replace("6.14", "6.15", 1))
    with pytest.raises(gb.InputError, match=r"mine\.toml: what it holds isn't what was written, by its digest"):
        read_reference(path).check_recorded()
    path.write_text(whole.replace('rms = "2 %"', 'rms = "3 %"'))
    with pytest.warns(gb.NoteWarning, match="has other settings than when it was recorded"):
        read_reference(path).check_recorded()
    path.write_text(re.sub(r"^(digest|settings) = .*\n", "", whole, flags=re.MULTILINE))
    with pytest.warns(gb.NoteWarning, match="carries no digest, so whether its figures were altered can't be told"):
        read_reference(path).check_recorded()


def said(reference):
    return repr(reference), repr(reference.recorded)


def test_of_300_flipped_bits_none_is_read_as_another_value_without_a_word(tmp_path):
    path = tmp_path / "mine.toml"
    trials = [replace(JAM, name=f"jam of {channel}") for channel in "pqr"]
    write_figures(path, text(), seed=1, groups=[HEALTHY, NORM, *trials])
    whole, values = path.read_bytes(), said(read_reference(path))
    for bit in np.random.default_rng(4).integers(0, 8 * len(whole), 300):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(bytes(flipped))
        with contextlib.suppress(gb.InputError), warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            reference = read_reference(path)
            reference.check_recorded()
            assert told or said(reference) == values


def test_a_baseline_that_couldnt_be_read_isnt_written(tmp_path):
    path = tmp_path / "mine.toml"
    many = [replace(JAM, name=f"jam of {i}") for i in range(LARGEST_TOML_BYTES // 50)]
    with pytest.raises(gb.InputError, match="a baseline has at most 100000; take fewer scenarios"):
        write_figures(path, text(), seed=1, groups=many)
    dotted = f"{text()}\nhealthy.flight = {{ hours = 1.0 }}\n"  # in [tolerances], so it isn't a figure at all
    with pytest.raises(gb.InputError, match=r"unknown key 'healthy' in \[tolerances\]"):
        write_figures(path, dotted, seed=1, groups=[HEALTHY])
    assert list(tmp_path.iterdir()) == []


def test_the_shipped_baselines_are_whole():
    assert set(shipped_baselines()) == {"bank-C", "dissertation"}
    for path in shipped_baselines().values():
        reference = read_reference(path)
        reference.check_recorded()
        assert len(reference.trials) == 15
        assert all(trial["detected"] for trial in reference.recorded["trials"].values())
        assert reference.recorded["healthy"]["flight"]["false_alarms"] == 0
        assert f"check {path.stem} --update" in path.read_text()
    assert find_detector(read_reference(shipped_baselines()["bank-C"]).detector).bank.name == "C"


@pytest.mark.nightly
def test_bank_c_still_names_the_gyro_that_its_baseline_says_it_names():
    """A fifth of what `gtmbench check bank-C` runs."""
    whole = read_reference(shipped_baselines()["bank-C"])
    jams = {name: trial for name, trial in whole.recorded["trials"].items() if name.startswith("jam")}
    recorded = {**whole.recorded, "trials": jams}
    reference = replace(whole, scenarios=(load_scenario("jam"),), recorded=recorded)
    outcome = check(reference, run_reference(reference))
    assert outcome.regressions == []
    assert [figure.figure for figure in outcome.compared].count("isolated") == 3
