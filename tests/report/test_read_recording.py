"""A recording read back: every number bit for bit, every verdict field for field, and a damaged file in one line."""

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from hypothesis import given, settings
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.report.recording import read as module
from gtmbench.report.recording.entities import Recording, trial_paths
from gtmbench.report.recording.read import check_recording
from tests.helpers.night import by_day
from tests.helpers.watching import drift
from tests.helpers.watching import study as monitored_study


@pytest.fixture(scope="module")
def study():
    return drift()


@pytest.fixture(scope="module")
def frame(frame_of):
    return frame_of(drift)


@pytest.fixture(scope="module")
def monitored(frame_of):
    return frame_of(monitored_study)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The bytes of a recording with everything that is read, and little of it."""
    path = tmp_path_factory.mktemp("small") / "small.rrd"
    with rr.RecordingStream("gtmbench") as recording:
        recording.save(path)
        time_s = np.arange(30) / 100.0
        values = np.random.default_rng(1).standard_normal((30, 2))
        Recording(stream=recording).log_lines(
            "/sensors/rates", time_s, values, ["p (deg/s)", "q (deg/s)"], ["#102030"] * 2
        )
        Recording(stream=recording).log_events("/events", [(0.1, "INFO", "something"), (0.2, "WARN", "something else")])
        Recording(stream=recording).log_verdict("/trials/drift/p/verdict", {"detected": True, "reason": ""})
        recording.log("/operator/r/p", rr.BarChart([1.0, 2.0], abscissa=[-1.0, 0.0]), static=True)
    return path.read_bytes()


def bits(values):
    return np.asarray(values, dtype=float).view(np.int64)


def rows_of(frame, entity, series):
    return frame[(frame.entity == entity) & (frame.series == series)]


def same_line(rows, time_s, values):
    there = np.isfinite(values)
    np.testing.assert_array_equal(bits(rows.value), bits(values[there]))
    np.testing.assert_allclose(rows.time_s, time_s[there], atol=1e-9, rtol=0.0)


def row_of(frame, root):
    """Put a verdict together again, from its fields: lists where names are numbers."""
    rows = frame[frame.entity == f"{root}/verdict"]
    row = {}
    for name, value, text in zip(rows.series, rows.value, rows.text, strict=True):
        *parents, last = name.split(".")
        of = row
        for parent in parents:
            of = of.setdefault(parent, {})
        of[last] = value if text == "nan" else text if isinstance(text, str) else None if np.isnan(value) else value
    return row


def plain(value):
    """Return a row as it comes back: lists by position, what is empty left out."""
    if isinstance(value, (list, tuple)):
        value = dict(enumerate(value))
    if isinstance(value, dict):
        return {str(key): plain(of) for key, of in value.items() if of not in ({}, [], ())}
    return value


@pytest.mark.parametrize(("study", "megabytes"), by_day([(drift, 40), (monitored_study, 20)], 0))
def test_a_recording_is_small_and_whole(recording_of, study, megabytes):
    program = Path(sys.executable).parent / "rerun"
    assert recording_of(study).stat().st_size < 1e6 * megabytes
    subprocess.run([program, "rrd", "verify", recording_of(study)], check=True, capture_output=True)


def test_residual_norm_and_threshold_come_back_bit_for_bit(study, frame):
    for trial, root in zip(study.trials, trial_paths(study.trials), strict=True):
        norm = trial.watch.scores["E(k)"]
        same_line(rows_of(frame, f"{root}/residual", "r"), trial.watch.record.time_s, trial.watch.residuals["r"])
        same_line(rows_of(frame, f"{root}/norm", "norm"), norm.known_s, norm.values)
        same_line(rows_of(frame, f"{root}/measured", trial.channel), trial.record.time_s, trial.record[trial.channel])
        alarm = rows_of(frame, f"{root}/alarm", "alarm")
        assert (alarm.time_s.item(), alarm.value.item()) == (trial.alarm_time_s, norm.threshold)
    threshold = rows_of(frame, "/threshold", "threshold")
    assert set(bits(threshold.value)) == set(bits([study.baseline.monitor.threshold]))
    assert list(threshold.time_s) == [0.0, 500.0]
    norm = study.baseline.watch.scores["E(k)"]
    same_line(rows_of(frame, "/healthy/norm", "norm"), norm.known_s, norm.values)


def test_signals_are_found_by_channel_and_the_operator_by_lag(study, frame):
    for channel, entity in (("p", "/sensors/rates"), ("beta", "/sensors/wind"), ("tas", "/sensors/speed")):
        same_line(rows_of(frame, entity, channel), study.baseline.healthy.time_s, study.baseline.healthy[channel])
    same_line(rows_of(frame, "/surfaces", "rudder"), study.baseline.flight.time_s, study.baseline.flight["rudder"])
    operator = study.baseline.monitor.operator
    for i, name in enumerate(operator.inputs):
        rows = rows_of(frame, f"/operator/r/{name}", "markov")
        np.testing.assert_array_equal(bits(rows.value), bits(operator.markov[:, 0, i]))
        assert list(rows.text) == [f"lag {lag:g}" for lag in operator.lags]
        assert rows.time_s.isna().all()


def test_verdicts_come_back_field_for_field(study, frame):
    for trial, root in zip(study.trials, trial_paths(study.trials), strict=True):
        assert row_of(frame, root) == plain(trial.row())
    healthy = row_of(frame, "/healthy")
    base, norm = study.baseline, study.baseline.watch.scores["E(k)"]
    known = {"false_alarms": base.false_alarms, "healthy_hours": base.healthy_hours}
    assert healthy == {"threshold": norm.threshold, "armed_s": norm.armed_s, **known}


def test_events_come_back_in_time_with_their_level(study, frame):
    events = frame[frame.entity == "/events"]
    assert events.time_s.is_monotonic_increasing
    assert events.value.isna().all()
    alarms = events[events.series == "ERROR"]
    assert sorted(alarms.time_s) == sorted(trial.alarm_time_s for trial in study.trials)
    assert all(" s after the onset" in text for text in alarms.text)


def test_a_row_takes_little_memory(frame):
    assert frame.memory_usage(deep=True).sum() < 24 * len(frame)
    assert len(frame) > 1_500_000


@pytest.mark.nightly
def test_a_monitored_study_comes_back_too(monitored):
    trials = monitored_study().trials
    verdicts = [row_of(monitored, root) for root in trial_paths(trials)]
    assert verdicts == [plain(trial.row()) for trial in trials]
    assert [row["alarm_time_s"] is None for row in verdicts] == [not trial.detected for trial in trials]
    for number, output in ((0, "p"), (3, "r")):
        root, watch = trial_paths(trials)[number], trials[number].watch
        level, from_s = watch.scores[output], 30.0 - 1e-9  # from 30 s before the onset on
        late = level.known_s >= from_s
        same_line(rows_of(monitored, f"{root}/levels/{output}", output), level.known_s[late], level.values[late])
        late, residual, virtual = watch.record.time_s >= from_s, watch.residuals[output], watch.virtual(output)
        same_line(rows_of(monitored, f"{root}/residuals/{output}", output), watch.record.time_s[late], residual[late])
        same_line(rows_of(monitored, f"{root}/virtual", output), watch.record.time_s[late], virtual[late])
        measured = trials[number].record.between(30.0, 120.0)
        same_line(rows_of(monitored, f"{root}/measured", output), measured.time_s, measured[output])


@pytest.mark.nightly
@settings(max_examples=3)
@given(
    values=st.lists(st.floats(), min_size=1, max_size=40),
    row=st.dictionaries(
        st.text("abc_", min_size=1), st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(), max_size=8
    ),
)
def test_any_number_and_any_field_comes_back(values, row, tmp_path_factory):
    path = tmp_path_factory.mktemp("any") / "any.rrd"
    values = np.array(values)
    time_s = np.arange(len(values)) * 0.01
    with rr.RecordingStream("gtmbench") as recording:
        recording.save(path)
        Recording(stream=recording).log_lines("/a/norm", time_s, values, ["a"], ["#102030"])
        Recording(stream=recording).log_verdict(
            "/a/verdict", row | {"unknown": float("nan"), "none": None, "inf": -np.inf}
        )
    frame = gb.read_recording(path)
    same_line(rows_of(frame, "/a/norm", "norm"), time_s, values)
    rows = frame[frame.entity == "/a/verdict"].set_index("series")
    for name, value in row.items():
        if isinstance(value, str):
            assert rows.text[name] == value
        elif value is None:
            assert np.isnan(rows.value[name])
            assert not isinstance(rows.text[name], str)
        else:
            assert bits([rows.value[name]]) == bits([value])
    assert rows.text["unknown"] == "nan"
    assert rows.value["inf"] == -np.inf


@pytest.mark.nightly
def test_lines_without_channels_are_called_what_the_viewer_shows_or_by_number(small, tmp_path):
    (tmp_path / "small.rrd").write_bytes(small)
    frame = gb.read_recording(tmp_path / "small.rrd")
    assert set(frame[frame.entity == "/sensors/rates"].series) == {"p (deg/s)", "q (deg/s)"}
    path = tmp_path / "bare.rrd"
    with rr.RecordingStream("gtmbench") as recording:
        recording.save(path)
        for step, values in enumerate(([1.0, 2.0], [3.0], [])):  # rows of different lengths
            recording.set_time("time", duration=float(step))
            recording.log("/bare", rr.Scalars(values))
    frame = gb.read_recording(path)
    assert list(zip(frame.series, frame.time_s, frame.value, strict=True)) == [
        ("bare 0", 0.0, 1.0),
        ("bare 0", 1.0, 3.0),
        ("bare 1", 0.0, 2.0),
    ]


def test_an_empty_recording_is_an_empty_table(tmp_path):
    with rr.RecordingStream("gtmbench") as recording:
        recording.save(tmp_path / "empty.rrd")
    frame = gb.read_recording(tmp_path / "empty.rrd")
    assert list(frame.columns) == ["entity", "series", "time_s", "value", "text"]
    assert len(frame) == 0


def messages(content):
    """Return where a recording's messages begin: a header of kind and length, then the message."""
    at, starts = 12, []
    while at + 16 <= len(content):
        starts.append(at)
        at += 16 + struct.unpack_from("<QQ", content, at)[1]
    return starts


def refused(path, capfd):
    with pytest.raises(gb.InputError) as error:
        gb.read_recording(path)
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")
    return str(error.value)


@pytest.mark.nightly
def test_what_is_no_whole_recording_is_refused_in_one_line(small, tmp_path, capfd):
    starts = messages(small)
    path = tmp_path / "bad.rrd"
    for content in (
        b"",
        b"RRF2" + bytes(1000),
        small[: len(small) // 2],
        small[: starts[2]],  # between two messages: every one of them is whole
        small[:-32] + struct.pack("<QQ", 1 << 60, 1 << 60) + small[-16:],  # a footer of an exabyte
    ):
        path.write_bytes(content)
        assert "isn't a whole rerun recording" in refused(path, capfd)
    path.write_bytes(small[: starts[-1]])  # all but the footer
    with pytest.raises(gb.InputError, match="isn't a whole rerun recording"):
        check_recording(path)
    assert "no such file" in refused(tmp_path, capfd)
    assert "no such file" in refused(tmp_path / "nowhere.rrd", capfd)


@pytest.mark.nightly
def test_another_applications_recording_is_refused_but_can_be_viewed(tmp_path, capfd):
    path = tmp_path / "other.rrd"
    with rr.RecordingStream("robot_arm") as recording:
        recording.save(path)
    assert "is a recording of 'robot_arm'" in refused(path, capfd)
    check_recording(path)


STREAM = "import os, sys, pyarrow as pa\nwith pa.ipc.new_stream(sys.stdout.buffer, pa.schema([])) as out: "
READERS = {
    "aborts": "import os; os.abort()",
    "says what it likes": "import sys; print('panicked', file=sys.stderr); print('not Arrow')",
    "ends in the middle": STREAM + "sys.stdout.buffer.flush(); os._exit(1)",
    "fails at the end": STREAM + "pass\nsys.exit(1)",
    "hangs": "import time; time.sleep(60)",
}


@pytest.mark.parametrize("what", READERS)
def test_a_reader_that_ends_badly_takes_nothing_with_it(what, small, tmp_path, monkeypatch, capfd):
    (tmp_path / "reader.py").write_text(READERS[what])
    (tmp_path / "small.rrd").write_bytes(small)
    monkeypatch.setattr(module, "_READER", tmp_path / "reader.py")
    monkeypatch.setattr(module, "_LONGEST_S", 1.0 if what == "hangs" else 60.0)
    # one that a busy machine is slow to read isn't called broken
    why = "wasn't read within 1 s: the machine is busy" if what == "hangs" else "isn't a whole rerun recording"
    assert why in refused(tmp_path / "small.rrd", capfd)
