"""Every script of `experiments/` runs by itself, agrees with what is printed, and draws its figures."""

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import scipy.stats

from gtmbench.errors import InputError
from gtmbench.report.dissertation.reproduction import RESULTS, reproduce
from gtmbench.report.figures.delays import delay_figure
from gtmbench.report.figures.panels import panels
from gtmbench.report.tables.markdown import interval, share_text

EXPERIMENTS = Path(__file__).parent.parent / "experiments"
PARTS = runpy.run_path(str(EXPERIMENTS / "__main__.py"))["PARTS"]
BEYOND = {  # studies of what the dissertation leaves open, with reports of their own, and lines that they print
    "which_gyro": (r"# Which gyro failed\?", r"\*\*Quick: ", r"\| C +\| jam +\| strong +\| 1 of 1 +\| 1 +\| 1 +\|"),
    "short_records": (r"\*\*Quick: ", r"\| C +\| B747, global5000 \| 0 of 2 "),  # no alarm on healthy records
}
SAID = {"aircraft_gyros": "0.36 and 9.1 deg/s", "choices": "r = 28, d = 50"}  # what the README says of them


def run(script, *options, cwd):
    command = [sys.executable, EXPERIMENTS / f"{script}.py", *options]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)


def test_every_script_is_run_by_make_experiments_or_has_a_report_of_its_own():
    assert {path.stem for path in EXPERIMENTS.glob("*.py")} == {*PARTS, *BEYOND, "__main__"}


@pytest.mark.parametrize("script", PARTS)
def test_a_part_agrees_with_the_dissertation(script, tmp_path, monkeypatch, capsys):
    """Within this process, which has imported what takes long; by its path alone, so that it needs no other script."""
    path = EXPERIMENTS / f"{script}.py"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path), "--quick", "--json", "--out", str(tmp_path / "deep" / script)])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(path), run_name="__main__")
    printed = capsys.readouterr()
    assert ended.value.code in (None, 0), printed.out + printed.err
    results = json.loads(printed.out)
    assert results == json.loads((tmp_path / "deep" / script / RESULTS).read_text())
    assert {row["agreement"] for row in results["rows"]} <= {"agrees", "not printed"}
    assert any(row["agreement"] == "agrees" for row in results["rows"])
    names = [row["result"] for row in results["rows"]]
    assert len(set(names)) == len(names), "a row's name says which result it is"
    assert SAID.get(script, "") in printed.out
    assert results["figures"]
    for figure in results["figures"]:
        pixels = matplotlib.image.imread(tmp_path / "deep" / script / figure)
        assert min(pixels.shape[:2]) > 200
        assert np.std(pixels[..., :3]) > 0.02, "something is drawn"


@pytest.mark.parametrize("script", BEYOND)
def test_a_study_beyond_the_dissertation_runs(script, tmp_path):
    done = run(script, "--quick", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    for line in BEYOND[script]:
        assert re.search(line, done.stdout)
    assert list(tmp_path.iterdir()) == []


def test_the_table_names_every_part_and_links_its_figures():
    page = (EXPERIMENTS / "README.md").read_text()
    for script in PARTS:
        assert f"`{script}.py`" in page
        results = json.loads((EXPERIMENTS / "reports" / script / RESULTS).read_text())
        assert not results["quick"]
        for row in results["rows"]:
            assert row["result"].replace("|", r"\|").replace("*", r"\*") in page
    linked = re.findall(r"\]\((reports/[^)]+)\)", page)
    assert len(linked) > 40
    assert all((EXPERIMENTS / name).is_file() for name in linked)


def test_make_experiments_runs_parts_and_keeps_nothing_of_quick_ones():
    before = (EXPERIMENTS / "README.md").read_bytes()
    done = subprocess.run(
        [sys.executable, EXPERIMENTS, "beam", "exact_operators", "--quick"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[:-1]] in (
        ["beam", "exact_operators"],
        ["exact_operators", "beam"],
    )
    assert (EXPERIMENTS / "README.md").read_bytes() == before
    wrong = subprocess.run([sys.executable, EXPERIMENTS, "bean"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 2
    assert "bean: no part of the dissertation" in wrong.stderr


def test_a_share_comes_with_the_interval_that_scipy_has():
    for hits, trials in ((0, 1), (1, 1), (1, 54), (53, 54), (322, 324)):
        theirs = scipy.stats.binomtest(hits, trials).proportion_ci(0.95)
        assert interval(hits, trials) == pytest.approx((theirs.low, theirs.high), abs=1e-9)
    assert share_text(0, 0) == "-"


def test_the_delays_figure_counts_what_was_missed_as_never_detected():
    (axis,) = delay_figure({"C": [2.0, np.nan, 0.5, np.inf]}).axes
    (line,) = axis.lines
    assert [list(line.get_xdata()), list(line.get_ydata())] == [[0.5, 2.0], [0.25, 0.5]]


def called(steps, *options, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["part.py", *map(str, options)])
    return reproduce(steps, "part.py", "A part.")


def test_a_number_agrees_within_its_tolerance_and_no_further(tmp_path, monkeypatch, capsys):
    def steps(page):
        page.number("Ex. 1, a", 0.5, 0.5004, tolerance=5e-4)
        page.number("Ex. 1, b", [1.0, 2.0], [1.0, 2.1], tolerance=0.05)
        page.unprinted("Ex. 1, c", "3", values={"c": 3 + 1j})

    assert called(steps, "--out", tmp_path / "a", monkeypatch=monkeypatch) == 1
    assert "1 of 2 agree" in capsys.readouterr().out
    rows = json.loads((tmp_path / "a" / RESULTS).read_text())["rows"]
    assert [row["agreement"] for row in rows] == ["agrees", "DISAGREES", "not printed"]
    assert [row["values"] for row in rows] == [0.5004, [1.0, 2.1], {"c": [3.0, 1.0]}]


@pytest.mark.parametrize("ours", [np.nan, [1.0, 1.0], np.inf])
def test_what_is_no_number_or_has_another_shape_never_agrees(ours, tmp_path, monkeypatch):
    def steps(page):
        page.number("Ex. 1", 1.0, ours, tolerance=10.0)

    assert called(steps, "--out", tmp_path / "a", monkeypatch=monkeypatch) == 1


def test_what_fails_leaves_nothing_behind(tmp_path, monkeypatch, capsys):
    def steps(page):
        page.draw("fig_1", panels(1, 1, (2.0, 2.0))[0])
        raise InputError("a plant is missing")

    assert called(steps, "--out", tmp_path / "a", monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().err == "part.py: a plant is missing\n"
    (tmp_path / "file").write_text("mine")
    assert called(steps, "--out", tmp_path / "file", monkeypatch=monkeypatch) == 2
    assert called(steps, "--out", tmp_path / "file" / "deep", monkeypatch=monkeypatch) == 2
    assert capsys.readouterr().err.count("\n") == 2
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
