"""In a notebook: values show themselves, whatever they are called, and `gb.plot` draws them."""

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import numpy as np
import pytest

import gtmbench as gb
from gtmbench import api

HOSTILE = "<script>alert('p')</script> & $x$"
SHORT = """
duration_s = 40.0
severity_reference_s = [5.0, 20.0]
operator = { causal_order = 5, noncausal_order = 5, identify_s = [2.0, 20.0] }
alarm = { window = 100, threshold_s = [10.0, 38.0], watch_from_s = 2.0 }
[[faults]]
kind = "jam"
channels = ["p", "altitude"]
onset_s = 20.0
"""


def seen(text):
    """Return the elements of a page, which has to be well formed, and the words of its rows."""
    page = ElementTree.fromstring(f"<div>{text.replace('<br>', '<br/>')}</div>")
    rows = [["".join(cell.itertext()) for cell in row] for row in page.iter("tr")]
    return {each.tag for each in page.iter()}, rows


@cache
def study():
    def spin(record):
        return record.time_s[np.abs(record["p"]) > 1e6]

    with TemporaryDirectory() as folder:
        path = Path(folder, "short.toml")
        path.write_text(SHORT)
        return gb.run_study([gb.load_scenario(path)], detectors=["dissertation", gb.FunctionDetector(spin)])


@pytest.fixture
def watched(tmp_path):
    """A log with a name of its own that its monitor can't tell anything of."""
    noise = np.random.default_rng(1).standard_normal((1500, 2))
    record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    path = tmp_path / "<b>&flight.csv"
    gb.write_log(gb.inject(record, gb.Noise(channel="q", onset_s=45.0, deviation=3.0)), path)
    return gb.watch_log(path, gb.bank_between(["p"], ["q"]), healthy=[(0.0, 30.0)])


def values(watched):
    trial = study().trials[0]
    return {
        "record": trial.record,
        "operator": trial.baseline.monitor.operator,
        "watch": trial.watch,
        "trial": trial,
        "study": study(),
        "log": watched.log,
        "watched": watched,
        "norm's monitor": trial.baseline.monitor,
        "bank's monitor": watched.monitor,
    }


def test_values_show_themselves_in_well_formed_html(watched):
    for name, value in values(watched).items():
        elements, rows = seen(value._repr_html_())
        assert elements <= {"div", "style", "p", "strong", "br", "table", "thead", "tbody", "tr", "th", "td"}, name
        assert all(len(row) == len(rows[0]) for row in rows), name
    verdict = gb.Verdict(**{name: getattr(study().trials[0], name) for name in gb.Verdict.__dataclass_fields__})
    assert "detected after" in verdict._repr_html_()


def test_what_files_and_users_call_things_is_escaped(watched):
    record = gb.Record([[1.0, np.nan], [3.0, np.nan]], channels=[HOSTILE, "p"], sample_period_s=0.5)
    elements, rows = seen(record._repr_html_())
    assert "script" not in elements
    assert rows[1:] == [[HOSTILE, "", "1", "2", "3", "1", "0"], ["p", "deg/s", "-", "-", "-", "-", "2"]]
    assert "<b>" not in watched._repr_html_()
    assert "<b>" not in watched.log._repr_html_()


def test_a_record_is_drawn_as_it_is_with_its_spikes():
    spiky = np.zeros(100_000)
    spiky[54_321] = 7.0
    record = gb.Record(np.column_stack([spiky, -spiky, spiky]), channels=["p", "q", HOSTILE], sample_period_s=0.01)
    gyros, other = gb.plot(record).axes
    assert gyros.get_ylabel() == "deg/s"
    for line, peak in zip([*gyros.lines, *other.lines], (7.0, -7.0, 7.0), strict=True):
        assert len(line.get_xdata()) < 5000
        at = np.argmax(np.abs(line.get_ydata()))
        assert line.get_ydata()[at] == peak
        assert line.get_xdata()[at] == pytest.approx(543.21, abs=0.6)


def test_a_trials_picture_has_onset_alarm_and_threshold():
    trial = study().trials[0]
    scores = gb.plot(trial).axes[0]
    assert trial.detected
    drawn = {line.get_label(): line for line in scores.lines}
    alarms = [line.get_xdata()[0] for line in scores.lines if line.get_label() == "alarm"]
    assert alarms == [alarm.time_s for alarm in trial.watch.faults]
    assert alarms[0] == trial.alarm_time_s
    assert drawn["onset"].get_xdata()[0] == 20.0
    assert drawn["threshold"].get_ydata()[0] == trial.baseline.monitor.threshold
    before = drawn["E(k)"].get_xdata() < trial.alarm_time_s - 0.05
    assert drawn["E(k)"].get_ydata()[before].max() <= trial.baseline.monitor.threshold  # drawn when it is known


def test_a_studys_picture_has_a_mark_for_every_trial():
    axis = gb.plot(study()).axes[0]
    marks = [line for line in axis.lines if len(line.get_xdata()) == 1]
    found = sorted(mark.get_xdata()[0] for mark in marks if mark.get_markerfacecolor() != "none")
    delays = sorted(trial.detection_delay_s for trial in study().trials if trial.detected)
    assert len(marks) == 4
    assert found == delays
    assert [label.get_text() for label in axis.get_yticklabels()] == ["jam of p", "jam of altitude"]


def test_everything_that_can_be_drawn_is_and_is_a_picture_in_a_notebook(watched):
    operator, record = study().baseline.monitor.operator, study().baseline.healthy
    left = gb.residual(operator, record)
    loop = gb.fly_in_loop(duration_s=3.0, faults=gb.SignFlip(channel="q", onset_s=1.0))
    drawn = {**values(watched), "residual": left, "norm": gb.windowed_norm(left, window=100), "loop": loop}
    figures = {name: gb.plot(value) for name, value in drawn.items() if "monitor" not in name}
    assert len(figures) == 10
    assert all(figure.axes for figure in figures.values())
    for name in ("trial", "study"):  # the others differ in what is drawn, not in how it is shown
        assert figures[name]._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    with pytest.raises(gb.InputError, match=r"^a int can't be drawn; give one of Record, "):
        gb.plot(3)


@pytest.mark.parametrize("name", ["from_trim_to_alarm", "break_a_gyro", "a_flight_log"])
def test_the_notebooks_of_the_docs_use_names_that_are_there(name):
    """The site's build executes them; here it is seen at once when a name of theirs goes."""
    text = (Path(__file__).parents[2] / f"docs/notebooks/{name}.md").read_text()
    cells = re.findall(r"^```\{code-cell\} ipython3\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    assert len(cells) > 9
    for cell in cells:
        compile(re.sub(r"^:tags:.*$", "", cell, flags=re.MULTILINE), name, "exec")
    assert set(re.findall(r"\bgb\.(\w+)", text)) <= set(api.__all__)
