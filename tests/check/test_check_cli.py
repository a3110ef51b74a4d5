"""`gtmbench check` as a team's CI runs it: exit codes, lines, files; from the scenario to the verdict."""

import json
import re
import shutil
import tomllib
from xml.etree import ElementTree as ET

import pytest

from gtmbench.bench.sensors import measure
from gtmbench.check import check as study_check
from gtmbench.check.baseline import new_baseline, write_figures
from gtmbench.check.figures import figures_of
from gtmbench.files.shipped import shipped_baselines
from tests.check.test_check import SHORT, study
from tests.helpers.hostile import refused
from tests.helpers.sealed import rerecorded
from tests.helpers.watching import EXAMPLE

SPIKE = 80.0  # deg/s, in one sample


@pytest.fixture
def baseline(tmp_path):
    """A committed baseline of a short scenario."""
    path, scenario = tmp_path / "mine.toml", tmp_path / "short.toml"
    scenario.write_text(SHORT)
    text = new_baseline(path, scenarios=[str(scenario)], detector=None)
    write_figures(path, text, seed=1, groups=figures_of(study()))
    return path


@pytest.fixture
def spiked(baseline, monkeypatch):
    """The same, but from now on every healthy record has one bad sample of r, at 77.3 s."""

    def measured(*given, **named):
        record = measure(*given, **named)
        if named["seed"] < 2001:  # operator and threshold come from healthy ones
            return record
        r = record["r"].copy()
        r[7730] += SPIKE
        return record.replace("r", r)

    monkeypatch.setattr("gtmbench.study.flights.measure", measured)
    return baseline


def test_a_first_update_makes_the_baseline_that_check_holds(cli, baseline):
    code, out, err = cli("check", "first.toml", "--update", "--scenario", "short.toml")
    assert (code, err) == (0, "")
    assert out == "Recorded 40 figures in first.toml; commit it, and run: gtmbench check first.toml\n"
    assert (baseline.parent / "first.toml").read_text() == baseline.read_text().replace("check mine", "check first")


def test_an_unchanged_monitor_passes_and_its_baseline_is_the_same_bytes(cli, baseline):
    before = baseline.read_bytes()
    code, out, err = cli("check", "mine.toml")
    assert (code, err) == (0, "")
    assert out == "No figure is worse than the baseline mine.toml allows; 0 better, 40 within their tolerances.\n"
    assert cli("check", "mine.toml", "-q") == (0, "", "")
    assert cli("check", "mine.toml", "--update")[:2] == (0, "None of 40 figures in mine.toml changes.\n")
    assert baseline.read_bytes() == before


def test_one_spike_in_one_sample_of_a_healthy_record_fails(cli, spiked):
    before = spiked.read_bytes()
    was = tomllib.loads(before.decode())["residual"]["r"]["windows"][5]
    code, out, err = cli("check", "mine.toml")
    assert (code, err) == (1, "")
    (line,) = [line for line in out.splitlines() if line.startswith("healthy residual of r, window")]
    assert line.startswith(f"healthy residual of r, window 75..85 s, max: was {was:g}, is ")
    assert line.endswith(f", allowed up to {1.05 * was:.5g} deg/s")
    assert "healthy flight, false alarms: was 0, is 2, allowed up to 0" in out
    assert out.splitlines()[-1] == "if that is what the change is meant to do: gtmbench check mine.toml --update"
    assert spiked.read_bytes() == before
    quiet, lines, _ = cli("check", "mine.toml", "-q")
    assert (quiet, lines.splitlines()) == (1, [line for line in out.splitlines() if ": was " in line])


def test_the_worst_comes_first(cli, baseline):
    worst = baseline.read_text().replace("flight]\nfalse_alarms = 0", "flight]\nfalse_alarms = 5")
    values = tomllib.loads(worst)
    limit, rms = values["score"]["E(k)"]["threshold"], values["residual"]["r"]["rms"]
    worst = worst.replace(f"threshold = {limit}", f"threshold = {0.5 * limit}").replace(
        f"rms = {rms}", f"rms = {0.9 * rms}"
    )
    baseline.write_text(rerecorded(worst.replace("detected = false", "detected = true, delay_s = 1.0")))
    code, out, _ = cli("check", "mine.toml")
    assert code == 1
    names = [line.split(": was")[0] for line in out.splitlines() if ": was " in line]
    assert names == ["short: jam of altitude, detected", "healthy score E(k), threshold", "healthy residual of r, RMS"]
    assert "better: healthy flight: false alarms" in out
    assert "3 of 40 figures are worse than the baseline mine.toml allows; 1 better, 36 within their tolerances." in out


@pytest.mark.usefixtures("spiked")
def test_what_is_meant_is_recorded_shown_and_passes_then(cli):
    code, out, _ = cli("check", "mine.toml", "--update")
    assert code == 0
    shown = [line.split() for line in out.splitlines()]
    assert ["healthy", "flight,", "false", "alarms", "0", "2"] in shown
    assert any("window 75..85 s, max (1 of 10 changed)" in line for line in out.splitlines())
    assert cli("check", "mine.toml")[0] == 0


@pytest.mark.filterwarnings("ignore:.*has other settings:gtmbench.errors.NoteWarning")
def test_a_tolerance_edited_by_hand_holds_and_stays(cli, baseline):
    text = baseline.read_text()
    rms = tomllib.loads(text)["residual"]["r"]["rms"]
    baseline.write_text(rerecorded(text.replace(f"\nrms = {rms}", f"\nrms = {0.95 * rms}")))
    assert cli("check", "mine.toml")[0] == 1
    generous = baseline.read_text().replace('rms = "2 %" ', "rms = 0.5  # we know")
    baseline.write_text(generous)
    assert cli("check", "mine.toml")[0] == 0
    assert cli("check", "mine.toml", "--update")[0] == 0
    again = rerecorded(generous.replace(f"\nrms = {0.95 * rms}", f"\nrms = {rms}"))
    settings = re.compile(r'^settings = "\w+"', re.MULTILINE)
    assert settings.sub("", baseline.read_text()) == settings.sub("", again) != baseline.read_text()


@pytest.mark.usefixtures("spiked")
def test_json_says_everything(cli):
    code, out, err = cli("check", "mine.toml", "--json")
    printed = json.loads(out)
    assert (code, err) == (1, "")
    assert printed["passed"] is False
    assert (printed["baseline"], printed["scenarios"], printed["seed"]) == ("mine.toml", ["short"], 1)
    assert printed["detector"] is None
    assert len(printed["figures"]) == 40
    told = [worse for worse in printed["findings"] if worse["at"] == "window 75..85 s"]
    (spike,) = [worse for worse in told if "residual" in worse["group"]]
    assert (spike["figure"], spike["unit"], spike["allowed_from"]) == ("windows", "deg/s", None)
    assert spike["is"] > spike["allowed_to"] > spike["was"]
    code, out, _ = cli("check", "mine.toml", "--update", "--json")
    changed = json.loads(out)
    assert (code, changed["command"]) == (0, "check-update")
    assert next(change["is"] for change in changed["findings"] if change["figure"] == "false_alarms") == 2


@pytest.mark.usefixtures("spiked")
def test_junit_has_a_case_for_each_group_and_its_failures(cli, tmp_path):
    code, out, _ = cli("check", "mine.toml", "--junit", "report.xml")
    assert code == 1
    root = ET.fromstring((tmp_path / "report.xml").read_text())
    (suite,) = root
    cases = {case.get("name"): case for case in suite}
    assert set(cases) == {
        "healthy flight",
        "healthy residual of r",
        "healthy score E(k)",
        *(f"short: {trial}" for trial in ("drift of q", "drift of r", "jam of p", "jam of altitude")),
    }
    failed = [case for case in suite if case.find("failure") is not None]
    assert (root.tag, suite.get("tests"), suite.get("failures")) == ("testsuites", "7", str(len(failed)))
    texts = [line for case in failed for line in case.find("failure").text.splitlines()]
    assert sorted(texts) == sorted(line for line in out.splitlines() if ": was " in line)
    assert all(case.get("classname") == "gtmbench.check.mine" for case in suite)


@pytest.mark.usefixtures("baseline")
def test_junit_of_a_pass_and_of_a_name_that_xml_cant_hold(cli, tmp_path):
    (tmp_path / "short.toml").rename(tmp_path / "a<b>.toml")
    assert cli("check", "odd\x01.toml", "--update", "--scenario", "a<b>.toml")[0] == 0
    assert cli("check", "odd\x01.toml", "--junit", "report.xml", "-q") == (0, "", "")
    suite = ET.fromstring((tmp_path / "report.xml").read_text())[0]
    assert suite.get("failures") == "0"
    assert suite.get("name") == "gtmbench check odd?"
    assert suite[3].get("name") == "a<b>: drift of q"


@pytest.mark.nightly
@pytest.mark.usefixtures("baseline")
def test_a_detector_of_ones_own_is_named_in_the_baseline_and_brought_by_the_command_line(cli, tmp_path, monkeypatch):
    """The baseline imports nothing: it states the name, and says so where nothing goes by that."""
    monkeypatch.setattr("gtmbench.study.watchers.FLIGHTS", 2)
    shutil.copy(EXAMPLE, tmp_path / "mine.py")
    own = ("--detector", "mine.py:LimitCheck")
    code, out, err = cli("check", "limits.toml", "--update", "--scenario", "short.toml", *own)
    assert (code, err) == (0, "")
    assert "Recorded 49 figures" in out
    stated = tomllib.loads((tmp_path / "limits.toml").read_text())
    assert (stated["detector"], list(stated["score"])) == ("limit check", ["p", "q", "r"])
    assert cli("check", "limits.toml", *own)[0] == 0
    assert cli("check", "limits.toml", "--update", *own)[0] == 0
    assert "no detector is called 'limit check'" in refused(cli("check", "limits.toml"))
    assert "limits.toml names limit check, and --detector C is 'C'" in refused(
        cli("check", "limits.toml", "--detector", "C")
    )


REFUSED = {
    "no baseline": (["nowhere.toml"], "no baseline 'nowhere.toml'; give one of bank-C, dissertation, or record one"),
    "a long name": (["x" * 5000], "no baseline 'xxx"),
    "a new one without --update": (
        ["new.toml", "--scenario", "jam"],
        "--scenario is for a new baseline, with --update",
    ),
    "scenarios of one that exists": (["mine.toml", "--update", "--scenario", "jam"], "names its own scenarios"),
    "a detector that it doesn't name": (
        ["mine.toml", "--update", "--detector", "C"],
        "mine.toml names no detector, and --detector C is 'C'; leave --detector out, or state detector = \"C\" there",
    ),
    "no scenario": (["new.toml", "--update", "--scenario", "jim"], "no scenario 'jim'"),
    "scenarios that differ": (
        ["new.toml", "--update", "--scenario", "jam", "--scenario", "short.toml"],
        "scenarios 'jam' and 'short' differ in duration_s",
    ),
    "no monitor": (["new.toml", "--update", "--detector", "none.json"], "none.json"),
    "no ending": (["new", "--update"], "should end in .toml"),
    "no folder": (["nowhere/new.toml", "--update"], "doesn't exist"),
    "no folder for junit": (["mine.toml", "--junit", "nowhere/x.xml"], "doesn't exist"),
    "junit of an update": (["mine.toml", "--update", "--junit", "x.xml"], "--update makes none"),
}


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.usefixtures("baseline")
def test_what_cant_be_run_is_one_line_and_exit_code_2(cli, tmp_path, name):
    arguments, message = REFUSED[name]
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert message in refused(cli("check", *arguments))
    assert message in json.loads(cli("check", *arguments, "--json")[1])["error"]
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_figures_of_another_seed_or_other_trials_end_with_2_before_the_run(cli, baseline, tmp_path, monkeypatch):
    monkeypatch.setattr(study_check, "run_study", lambda *_, **__: pytest.fail("it ran"))
    text = baseline.read_text()
    for old, new, message in (
        ("seed = 1\n#", "seed = 2\n#", "its figures are those of seed 1, and the seed is 2"),
        ('scenarios = ["short.toml"]', 'scenarios = ["short.toml", "jam"]', "no figures of trial 'jam of p' yet"),
        ('"short: jam of p" =', '"short: jam of nz" =', "no figures of trial 'short: jam of p' yet"),
    ):
        assert text.count(old) == 1
        baseline.write_text(text.replace(old, new))
        assert message in refused(cli("check", "mine.toml", "--junit", "report.xml"))
        assert not (tmp_path / "report.xml").exists()


@pytest.mark.usefixtures("baseline")
def test_a_bug_in_what_is_run_is_no_regression(cli, monkeypatch):
    """Python would end with 1, which means another thing here."""

    def broken(*_, **__):
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setattr("gtmbench.detectors.windowed_norm.residual", broken)
    code, out, err = cli("check", "mine.toml")
    assert (code, out) == (2, "")
    assert err.splitlines()[-1] == "gtmbench: the run failed: ZeroDivisionError: float division by zero"
    assert "Traceback" in err
    assert json.loads(cli("check", "mine.toml", "--json")[1])["exit_code"] == 2


def test_an_installed_packages_baseline_isnt_written(cli, monkeypatch):
    shipped = shipped_baselines()["dissertation"]
    before = shipped.read_bytes()
    monkeypatch.setattr("gtmbench.cli.check.is_installed", lambda: True)
    for source in ("dissertation", shipped):
        assert "part of the installed package, which isn't written into" in refused(cli("check", source, "--update"))
    assert shipped.read_bytes() == before


@pytest.mark.nightly
def test_a_checkout_may_renew_its_own(cli, tmp_path, monkeypatch):
    copy = tmp_path / "dissertation.toml"
    copy.write_text(shipped_baselines()["dissertation"].read_text().replace("detected = true", "detected = false", 1))
    monkeypatch.setattr("gtmbench.check.baseline.shipped_baselines", lambda: {"dissertation": copy})
    assert cli("check", "--update")[0] == 0
    assert copy.read_bytes() == shipped_baselines()["dissertation"].read_bytes()
