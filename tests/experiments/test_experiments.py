"""Every script of `experiments/` runs by itself, comes out as committed, and draws its figures."""

import errno
import json
import re
import runpy
import subprocess
import sys
from typing import NamedTuple

import matplotlib.image
import numpy as np
import pytest
import scipy.stats

from dissertation.reproduction import RESULTS, reproduce, tally
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.isolation.hypotheses import families
from gtmbench.errors import InputError
from gtmbench.faults.registry import FAULTS
from gtmbench.files.folders import SUMS
from gtmbench.files.shipped import source_digest
from gtmbench.report.figures.panels import panels
from gtmbench.report.figures.scores import delay_figure
from gtmbench.study.scores.intervals import exact_interval
from studies.conduct import Findings, conducted
from studies.tables import share_text
from tests.helpers.night import by_day
from tests.helpers.scripts import EXPERIMENTS
from tests.helpers.scripts import script as defined_in

PAGE = EXPERIMENTS.parent / "docs/reference/dissertation.md"
PARTS = runpy.run_path(str(EXPERIMENTS / "__main__.py"))["PARTS"]
BEYOND = {  # studies of what the dissertation leaves open, with reports of their own, and lines that they print
    "every_fault": (
        r"# Every fault\n\n\*\*Quick: ",
        r"\| psi +\| 100.0 % .* of 3 \|",  # detected
        r"\| replacing \| gyro +\| ",
        r"\| noise \| [0-9.]+ deg/s \|",  # the smallest that is found
    ),
    "strange_faults": (r"# Strange faults\n\n\*\*Quick: ", r"\| bursts +\| strong +\| 100.0 % .* of 2 "),
    "several_at_once": (
        r"# Several sensors hit at once\n\n\*\*Quick: ",
        r"\| common cause +\| all gyros warm up +\| 1 +\| 1 +\| 0 ",  # detected, and no healthy sensor named
    ),
    "believed_names": (
        r"# Names that can be believed\n\n\*\*Quick: ",
        r"\| 0.99 to 1 +\| 0.99\d +\| (9\d|100).\d % ",  # stated, and how often it came true
        r"\| stuck +\| 1 +\| 100.0 % ",  # its onset is told, and in its interval
    ),
    "other_sensors": (
        r"# Other sensors, other tests\n\n\*\*Quick: ",
        r"\| 1 s +\| 100.0 % .* of 1 ",
        r"\| cusum +\| 100.0 % .* of 1 ",
    ),
    "in_the_loop": (
        r"# In the loop\n\n\*\*Quick: ",
        r"\| jam +\| q +\| [0-9.]+ ",  # detected, wherever it is put
        r"\| virtual rate \(C-early\) \| 1 +\| 0 ",  # no departure
    ),
    "early_alarms": (r"# Alarms that don't wait\n\n\*\*Quick: ", r"\| as it is +\| C-early +\| 100.0 % .* of 1 +\|"),
    "other_aircraft": (r"# Other aircraft\n\n\*\*Quick: ", r"\| A320: right gyro 6 of 6 .* yes", r"\| `c172p` "),
    "several_imus": (r"\| synthetic \| driven by the broken IMU \| 2 +\| 6 +\| 6 +\| 0 +\| 0 ",),  # none named wrong
    "airframes": (r"\| healthy airframes accused +\| 0 ", r"\| a healthy gyro named +\| 0 "),
    "short_records": (r"\*\*Quick: ", r"\| C +\| B747, global5000 \| 0 of 2 "),  # no alarm on healthy records
}
SAID = {"choices": "r = 28, d = 50"}  # what docs/how_to/identify.md says of it


class Ended(NamedTuple):
    """How a script ended, and what it printed."""

    code: int
    out: str
    err: str


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run scripts by their paths in an empty folder, within this process, which has imported what takes long."""

    def ran(script, *options):
        path = EXPERIMENTS / f"{script}.py"
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")  # which scripts set
        monkeypatch.setattr(sys, "argv", [str(path), *map(str, options)])
        monkeypatch.setattr("os.cpu_count", lambda: 1)
        code = 0
        try:
            runpy.run_path(str(path), run_name="__main__")
        except SystemExit as ended:
            code = ended.code or 0
        return Ended(code, *capsys.readouterr())

    return ran


def hold(values, committed, where):
    """Hold a row's values against the committed ones: to 1e-6 of the largest beside them, what is all but 0 to 1e-8.

    That is rounding, and room: another BLAS (OPENBLAS_CORETYPE) moved values by up to 2e-10 of the largest, another
    machine those of flights by up to 1e-8. A quick path over gamma has some of the full one's keys.
    """
    if isinstance(committed, dict):
        assert values.keys() & committed.keys(), where
        for key in values.keys() & committed.keys():
            hold(values[key], committed[key], f"{where}: {key}")
        return
    if isinstance(committed, list) and not all(isinstance(entry, int | float) for entry in committed):
        assert len(values) == len(committed), where
        for i, entries in enumerate(zip(values, committed, strict=True)):
            hold(*entries, f"{where}: {i}")
        return
    if committed is None or isinstance(committed, str):
        assert values == committed, where
        return
    tolerance = 1e-6 * np.abs(committed).max(initial=0.0) + 1e-8
    np.testing.assert_allclose(values, committed, rtol=0, atol=tolerance, err_msg=where)


def test_every_script_is_run_by_make_experiments_or_has_a_report_or_a_line_in_the_readme():
    told = (EXPERIMENTS / "README.md").read_text() + (EXPERIMENTS.parent / "Makefile").read_text()
    scripts = {path.stem for path in EXPERIMENTS.glob("*.py")} - {*PARTS, *BEYOND, "__main__"}
    alone = [each for each in scripts if not (EXPERIMENTS / "reports" / each / "report.md").is_file()]
    assert [each for each in alone if f"{each}.py" not in told] == []


@pytest.mark.parametrize("script", by_day(PARTS))
def test_a_part_comes_out_as_committed(script, tmp_path, run):
    done = run(script, "--quick", "--json", "--out", tmp_path / "deep" / script)
    assert done.code == 0, done.out + done.err
    results = json.loads(done.out)
    assert results == json.loads((tmp_path / "deep" / script / RESULTS).read_text())
    names = [row["result"] for row in results["rows"]]
    assert len(set(names)) == len(names), "a row's name says which result it is"
    committed = json.loads((EXPERIMENTS / "reports" / script / RESULTS).read_text())
    for key in ("result", "printed", "agreement", "expected"):
        assert [row[key] for row in results["rows"]] == [row[key] for row in committed["rows"]], key
    for row, before in zip(results["rows"], committed["rows"], strict=True):
        if row["runs"] == before["runs"]:  # else it stands on fewer random cases than the committed one
            hold(row["values"], before["values"], row["result"])
    assert SAID.get(script, "") in done.out
    assert results["figures"]
    for figure in results["figures"]:
        pixels = matplotlib.image.imread(tmp_path / "deep" / script / figure)
        assert min(pixels.shape[:2]) > 200
        assert np.std(pixels[..., :3]) > 0.02, "something is drawn"


@pytest.mark.nightly
@pytest.mark.parametrize("script", BEYOND)
def test_a_study_beyond_the_dissertation_runs(script, tmp_path, run):
    done = run(script, "--quick")
    assert done.code == 0, done.out + done.err
    for line in BEYOND[script]:
        assert re.search(line, done.out)
    assert list(tmp_path.iterdir()) == []


def alarm(sensor, *candidates, doubt=""):
    judged = Judgement(time_s=5.0, sensor=sensor, candidates=candidates, doubt=doubt)
    return Alarm(number=0, time_s=4.0, onset_s=3.0, source="q", judgements=(judged,))


@pytest.mark.parametrize(
    ("alarms", "said"),
    [
        ([alarm("q", "q")], "named"),
        ([alarm("theta", "theta")], "named wrong"),
        ([alarm("q", "q"), alarm("p", "p")], "named wrong"),
        ([alarm(None, "q", "theta")], "either-or"),
        ([alarm(None, "phi", "theta")], "named wrong"),
        ([alarm(None, "q", "theta"), alarm("q", "q")], "named"),
        ([alarm(None, "q", "theta", doubt="motion or model")], "can't tell"),
        ([alarm(None, "p", "phi", doubt="motion or model"), alarm("q", "q")], "named"),
        ([], "nothing"),
    ],
)
def test_what_is_said_of_a_fault_of_q_is_summed_up(alarms, said):
    assert defined_in("recorded/whole")["verdict_on"](alarms, "q") == said


def test_every_kind_is_studied_and_every_family_of_hypotheses_left_out():
    kinds = runpy.run_path(str(EXPERIMENTS / "every_fault.py"))["KINDS"]
    assert set(kinds) == set(FAULTS) - {"float"}  # of surfaces only
    assert {kind.family for kind in kinds.values()} - {""} == set(families())


@pytest.mark.nightly
def test_the_gallery_has_a_panel_for_every_kind_and_is_in_the_docs(tmp_path, run):
    script = runpy.run_path(str(EXPERIMENTS / "fault_gallery.py"))
    assert {fault.kind for fault in script["faults"]().values()} == set(FAULTS)
    done = run("fault_gallery", "--out", tmp_path)
    assert (done.code, done.err) == (0, "")
    drawn, kept = (
        matplotlib.image.imread(at / "fault_gallery.png") for at in (tmp_path, EXPERIMENTS.parent / "docs/reference")
    )
    assert drawn.shape == kept.shape
    assert np.std(drawn[..., :3]) > 0.02, "something is drawn"


def test_the_table_names_every_part_and_links_its_figures():
    page, said = PAGE.read_text(), []
    for script in PARTS:
        assert f"`{script}.py`" in page
        results = json.loads((EXPERIMENTS / "reports" / script / RESULTS).read_text())
        assert not results["quick"]
        said += [row["agreement"] for row in results["rows"]]
        for row in results["rows"]:
            name = (
                row["result"] if row["agreement"] == "differs" else row["result"].partition(", ")[0].partition(": ")[0]
            )
            assert row["agreement"] == "not printed" or name.replace("|", r"\|").replace("*", r"\*") in page
    assert tally(said) in page, "the headline counts what agrees, what differs and what isn't printed"
    linked = re.findall(r"\]\((\.\./\.\./experiments/reports/[^)]+)\)", page)
    assert len(linked) > 40
    assert all((PAGE.parent / name).is_file() for name in linked)


@pytest.mark.nightly
def test_make_experiments_runs_parts_and_keeps_nothing_of_quick_ones():
    before = PAGE.read_bytes()
    done = subprocess.run(
        [sys.executable, EXPERIMENTS, "beam", "exact_operators", "--quick"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[:-1]] in (
        ["beam", "exact_operators"],
        ["exact_operators", "beam"],
    )
    assert PAGE.read_bytes() == before
    wrong = subprocess.run([sys.executable, EXPERIMENTS, "bean"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 2
    assert "bean: no part of the dissertation" in wrong.stderr


def test_a_share_comes_with_the_interval_that_scipy_has():
    for hits, trials in ((0, 1), (1, 1), (1, 54), (53, 54), (322, 324)):
        theirs = scipy.stats.binomtest(hits, trials).proportion_ci(0.95)
        assert exact_interval(hits, trials) == pytest.approx((theirs.low, theirs.high), abs=1e-9)
    assert share_text(0, 0) == "-"


def test_the_delays_figure_counts_what_was_missed_as_never_detected():
    (axis,) = delay_figure({"C": [2.0, np.nan, 0.5, np.inf]}).axes
    (line,) = axis.lines
    assert [list(line.get_xdata()), list(line.get_ydata())] == [[0.5, 0.5, 2.0, 2.1], [0.0, 0.25, 0.5, 0.5]]


def called(steps, *options, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["part.py", *map(str, options)])
    return reproduce(steps, "part.py", "A part.")


def test_a_number_agrees_within_its_tolerance_and_no_further(tmp_path, monkeypatch, capsys):
    def steps(page):
        page.number("Ex. 1, a", 0.5, 0.5004, tolerance=5e-4)
        page.number("Ex. 1, b", [1.0, 2.0], [1.0, 2.1], tolerance=0.05, differs="misprint")
        page.unprinted("Ex. 1, c", "3", values={"c": 3 + 1j})

    assert called(steps, "--out", tmp_path / "a", monkeypatch=monkeypatch) == 0
    assert "1 agree, 1 differ, 1 not printed" in capsys.readouterr().out
    rows = json.loads((tmp_path / "a" / RESULTS).read_text())["rows"]
    assert [row["agreement"] for row in rows] == ["agrees", "differs", "not printed"]
    assert [row["values"] for row in rows] == [0.5004, [1.0, 2.1], {"c": [3.0, 1.0]}]


@pytest.mark.parametrize(
    "step",
    [
        lambda page: page.claim("Fig. 1", "5", "7", agrees=False),
        lambda page: page.claim("Fig. 1", "5", "5", agrees=True, differs="another search"),
        lambda page: page.claim("Fig. 1", "5", "7", agrees=False, differs="another search", holds=False),
        lambda page: page.claim("Fig. 1", "5", "5", agrees=True, holds=False),
        lambda page: page.unprinted("Fig. 1", "7", holds=False),
    ],
    ids=["differs unexplained", "agrees in spite of it", "differs otherwise", "agrees otherwise", "doesn't hold"],
)
def test_a_row_that_isnt_as_its_script_says_fails_and_is_named(step, tmp_path, monkeypatch, capsys):
    assert called(step, "--out", tmp_path / "a", monkeypatch=monkeypatch) == 1
    assert capsys.readouterr().err.startswith("part.py: Fig. 1: ")
    (row,) = json.loads((tmp_path / "a" / RESULTS).read_text())["rows"]
    assert not row["expected"]


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


@pytest.mark.parametrize(("options", "missed", "code"), [((), True, 1), ((), False, 0), (("--quick",), True, 0)])
def test_a_study_ends_with_1_where_it_misses_a_target_but_a_quick_one(
    options, missed, code, tmp_path, monkeypatch, capsys
):
    def conduct(campaign):
        assert campaign.jobs == 3
        return Findings("# Found\n\n| n |\n|---|\n| 1 |", missed, lambda out: (out / "rows.csv").write_text("1\n"))

    out = tmp_path / "deep" / "out"
    monkeypatch.setattr(sys, "argv", ["study.py", *options, "--jobs", "3", "--out", str(out)])
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    assert conducted(conduct, "A study.", quick="one flight") == code
    assert capsys.readouterr().out.startswith("# Found\n")
    written = {path.name: path.read_text() for path in out.iterdir() if path.name != SUMS}
    results = json.loads(written.pop(RESULTS))
    assert written == {"report.md": "# Found\n\n| n |\n|---|\n| 1 |", "rows.csv": "1\n"}
    assert results["tables"] == [[{"n": "1"}]]
    assert (results["script"], results["given"]) == ("study.py", {"quick": bool(options)})
    assert results["code"]["source"] == source_digest(), "which code made it"


def test_a_study_that_cant_be_written_leaves_the_one_that_stood_there(tmp_path, monkeypatch, capsys):
    def full(_out):
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "out").mkdir()
    (tmp_path / "out/report.md").write_text("before")
    monkeypatch.setattr(sys, "argv", ["study.py", "--out", str(tmp_path / "out")])
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    with pytest.raises(SystemExit) as ended:
        conducted(lambda _: Findings("# Found", False, full), "A study.", quick="one flight")
    assert ended.value.code == 2
    assert f"can't write {tmp_path / 'out'}: No space left on device" in capsys.readouterr().err
    assert {path.name: path.read_text() for path in (tmp_path / "out").iterdir()} == {"report.md": "before"}
