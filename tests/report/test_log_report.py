"""What a watched log leaves behind: words, plain data, a figure, a recording."""

import json
import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.detectors.statistics.thresholds import rate_bound
from gtmbench.report.figures.log import log_figure, write_log_figure
from gtmbench.report.figures.panels import thinned
from gtmbench.report.log_findings import failed_first
from gtmbench.report.recording.write import write_log_recording
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.log import log_report
from gtmbench.report.words.verdict import summary_lines, verdict_text
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.values.attitude_estimators import AttitudeEstimator
from gtmbench.verdict.scope import Scope
from tests.helpers.logged import (
    CASES,
    ODD,
    jammed,
    normed,
    odd,
    passing,
    remark,
    short,
    silent,
    standing,
    unwatched,
)
from tests.helpers.night import by_day
from tests.helpers.watching import written_once

cases = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a function that writes a case's recording, once, and gives its path."""
    return written_once(write_log_recording, tmp_path_factory.mktemp("recordings"))


@pytest.fixture(scope="module")
def read(recorded):
    """Return a function that reads a case's recording, once."""
    return cache(lambda case: gb.read_recording(recorded(case)))


@cases
def test_every_alarm_and_every_remark_is_named_with_its_time(case):
    watched, text = case(), "\n".join(log_report(case()))
    for alarm in watched.alarms[:12]:
        assert f"{alarm.time_s:.2f} s  " in text
        assert all(name in text for name in alarm.candidates)
        if alarm.last is not None and alarm.last.kind is not None:
            kind = "unknown kind" if alarm.last.kind == "unknown" else alarm.last.kind.replace("_", " ")
            assert (f"; {kind}" if alarm.sensor else f"; if {alarm.candidates[0]}, {kind}") in text
    for told in watched.log.remarks:
        assert f"remark: {told.start_s:.2f} to {told.end_s:.2f} s  {told.kind}" in text
    assert all(reason in text for reason in watched.reasons)
    assert all(line in text for line in watched.log.method)


def test_the_report_tells_a_fault_from_beginning_to_end():
    text = "\n".join(log_report(passing()))
    sure = r"\(sensor over 99 %, kind \d\d %\)\n"
    assert re.search(r"60\.\d\d s  p failed; saturation 3 deg/s, from (59\.9\d|60\.0\d) s " + sure, text)
    assert re.search(r"named at 6[0-2]\.\d\d s; gone since (89\.9|90\.0)\d s", text)
    assert "psi failed; jam at " in text
    assert "its end was not seen; no longer watched: p, q, r" in text
    assert re.match(
        r"The roll gyro \(p\) failed from (59|60)\.\d to (89|90)\.\d s: saturation ", verdict_text(passing())
    )
    assert re.search(r"; the heading \(psi\) failed from 1(69|70)\.\d s on: jam at ", verdict_text(passing()))


def test_an_alarm_that_may_be_no_faults_is_said_to_be_so():
    alarm = odd().alarms[0]
    assert all(other.sensor is None for other in odd().alarms)
    assert set(alarm.last.candidates) == set(ODD)  # which of them nothing tells
    assert alarm.last.reason
    asked = replace(odd(), scope=Scope(sensors=tuple(ODD)))
    assert verdict_text(asked).startswith("Cannot tell: ")
    for sensor in ODD:
        doubted = [span for span in asked.timeline.sensors[sensor] if span.reason == alarm.last.doubt]
        assert [span.state for span in doubted][:1] == ["not judged"]
        assert doubted[0].start_s <= alarm.time_s <= doubted[-1].end_s
    assert alarm.last.doubt == "motion or model"
    assert int(asked.outcome) == 3


def test_a_long_list_of_remarks_is_shortened_and_counted():
    many = [remark(float(i), float(i), "duplicate") for i in range(30)] + [remark(90.0, 95.0)]
    lines = log_report(replace(short(), log=replace(short().log, remarks=tuple(many))))
    told = [line for line in lines if line.startswith("remark: ")]
    (rest,) = [line for line in lines if " remarks more" in line]
    assert rest == f"{31 - len(told)} remarks more, up to 95.00 s: duplicate ({30 - len(told)}), gap (1)"


WORDS = {0: "No fault found", 1: " failed from ", 3: "Cannot tell"}


@cases
def test_the_words_match_the_exit_code(case):
    results = log_results(case())
    assert results["exit_code"] == case().verdict.exit_code
    assert next(code for code in (1, 0, 3) if WORDS[code] in results["verdict"]) == results["exit_code"]
    assert log_report(case(), 10_000)[0] == results["verdict"]


@cases
def test_the_summary_fits_a_narrow_screen(case):
    lines = summary_lines(case())
    assert " ".join(lines).startswith(verdict_text(case()).split(";")[0][:40])
    assert len(lines) <= 12
    assert max(map(len, lines)) <= 80


@cases
def test_the_bound_is_that_of_the_length_watched(case):
    watched, text = case(), "\n".join(log_report(case()))
    passed = sum(alarm.has_passed for alarm in watched.alarms)
    bound = rate_bound(passed, watched.armed_hours)
    results = log_results(watched)
    assert (results["false_alarms_per_hour_at_most"], results["alarms_unexplained"]) == (bound, passed)
    if bound is None:
        assert "no false alarm rate is bounded" in text
    else:
        seconds = 3600.0 * watched.armed_hours
        assert f"{seconds:.1f} s watched: at most {bound:.0f} false alarms an hour at 95 %" in text


@cases
def test_results_are_plain_data_and_say_what_the_watch_says(case):
    watched, results = case(), log_results(case())
    assert json.loads(json.dumps(results, allow_nan=False)) == results
    assert (results["command"], results["outcome"]) == ("monitor", watched.outcome.name.lower())
    for row, alarm in zip(results["findings"], watched.alarms, strict=True):
        assert (row["alarm_s"], row["sensor"], row["text"]) == (alarm.time_s, alarm.sensor, alarm.verdict)
        assert [judgement["time_s"] for judgement in row["judgements"]] == [
            judgement.time_s for judgement in alarm.judgements
        ]
        assert (row["parameters"], row["candidates"]) == (
            alarm.last.parameters if alarm.last else {},
            list(alarm.candidates),
        )
        last = alarm.last or gb.Judgement(time_s=alarm.time_s, sensor=None, candidates=())
        assert (row["kind"], row["partner"], row["reason"]) == (last.kind, last.partner, last.reason)
        assert list(row["parameter_units"]) == list(row["parameters"])
    assert [told["text"] for told in results["log"]["remarks"]] == [told.text for told in watched.log.remarks]
    assert results["log"]["segments_s"] == [[segment.start_s, segment.end_s] for segment in watched.log.segments]
    assert len(results["residuals"]) == sum(len({*watch.scores, *watch.residuals}) for watch in watched.watches)
    assert {"gtmbench", "python", "numpy"} <= set(results["versions"])


def test_results_measure_every_residual_on_every_segment():
    rows = {(row["start_s"], row["residual"]): row for row in log_results(jammed())["residuals"]}
    watch = jammed().watches[1]
    jam, level = rows[146.5, "q"], watch.scores["q"]
    peak = np.nanmax(level.values)
    assert (jam["peak_level"], jam["unit"]) == (peak, "deg/s")
    assert jam["peak_level_s"] == level.known_s[np.flatnonzero(level.values == peak)[0]] > 170.0
    assert jam["rms"] == pytest.approx(np.sqrt(np.nanmean(watch.residuals["q"] ** 2)))
    assert jam["rms_signal"] == pytest.approx(np.nanstd(watch.record["q"]))
    assert jam["rms"] > 5.0 * jam["rms_identified"] > 4.0 * rows[63.0, "q"]["rms"]
    before, missing = rows[63.0, "q"], rows[63.0, "p"]
    assert 3600.0 * (before["watched_hours"] - missing["watched_hours"]) > 2.0  # p misses two seconds there


@pytest.mark.parametrize("case", by_day([passing, odd, unwatched, normed, standing, silent], 0))
def test_the_figure_has_something_on_it(case, tmp_path):
    from matplotlib.image import imread

    write_log_figure(case(), tmp_path / "log.png")
    picture = imread(tmp_path / "log.png")[:, :, :3]
    assert min(picture.shape[:2]) > 600
    assert np.std(picture) > 0.05  # a blank page has none


@pytest.mark.nightly
def test_the_figure_shows_what_a_gyro_reads_more_beside_what_is_predicted_for_its_fault(tmp_path):
    flight = MECHANISMS["plain"](3).record.select(["p", "q", "r", "phi", "theta", "psi"])
    broken = gb.inject(flight, gb.Bias(channel="p", onset_s=flight.end_s - 70.0, size=1.5))
    gb.write_log(AttitudeEstimator(time_constant_s=5.0).bent(flight, broken), tmp_path / "log.csv")
    said = gb.watch_log(tmp_path / "log.csv", "auto", attitude="driven")
    assert [alarm.source for alarm in said.whole_alarms] == ["p"]
    panel = next(axis for axis in log_figure(said).axes if axis.get_ylabel().startswith("p less"))
    lines = {line.get_label(): line.get_ydata() for line in panel.get_lines()}
    (mean,) = (values for label, values in lines.items() if "its mean over" in label)
    (made,) = (values for label, values in lines.items() if label == "predicted for bias of p")
    assert np.nanmax(mean) == pytest.approx(np.nanmax(made), abs=0.6)
    assert np.nanmax(made) > 0.8


@given(st.integers(1, 400), st.integers(0, 40), st.randoms(use_true_random=False))
def test_thinning_keeps_extremes_and_gaps(rows, every, random):
    values = np.array([random.gauss(0.0, 1.0) for _ in range(rows)])
    start = random.randrange(rows)
    values[start : start + 2 * every] = np.nan
    time_s = 5.0 + 0.01 * np.arange(rows)
    when, drawn = thinned(time_s, values, every=every)
    assert len(when) == len(drawn) <= (rows if every <= 2 else 2 * -(-rows // every))
    if np.isfinite(values).any():
        assert (np.nanmin(drawn), np.nanmax(drawn)) == (np.nanmin(values), np.nanmax(values))
    assert np.isnan(drawn).any() or start + 2 * every > rows or every == 0
    assert (np.diff(when) >= 0.0).all()
    assert (when[0], when[-1] <= time_s[-1]) == (time_s[0], True)


def of(frame, entity):
    rows = frame[frame.entity == entity]
    return rows.time_s.to_numpy(), rows.value.to_numpy()


def lines_of(watched):
    """Yield what a recording should hold: entity, times and values of its stretches."""
    groups = {
        "p": "rates",
        "q": "rates",
        "r": "rates",
        "phi": "attitude",
        "tas": "speed",
        **dict.fromkeys(ODD, "other"),
    }
    for name in groups:
        if name in watched.log.channels:
            yield (
                f"/sensors/{groups[name]}/{escaped(name)}",
                [(segment.time_s, segment[name]) for segment in watched.log.segments],
            )
    for output in watched.watches[0].residuals:
        name = escaped(output)
        yield f"/residuals/{name}", [(watch.record.time_s, watch.residuals[output]) for watch in watched.watches]
        yield f"/virtual/{name}", [(watch.record.time_s, watch.virtual(output)) for watch in watched.watches]
    for of in watched.watches[0].scores:
        scores = [watch.scores[of] for watch in watched.watches]
        yield f"/levels/{escaped(of)}", [(score.known_s, score.values / score.threshold) for score in scores]


def escaped(name):
    import rerun as rr

    return rr.escape_entity_path_part(name)


@pytest.mark.parametrize("case", by_day([jammed, passing, odd, normed, standing]))
def test_signals_come_back_from_the_recording_bit_for_bit(case, read):
    frame = read(case)
    for entity, parts in lines_of(case()):
        time_s, values = (np.concatenate(column) for column in zip(*parts, strict=True))
        there = np.isfinite(values)
        times, signal = of(frame, entity)
        np.testing.assert_array_equal(signal, values[there], err_msg=entity)
        np.testing.assert_allclose(times, time_s[there], rtol=0.0, atol=1e-9)
    angle = case().watches[0].virtual("psi") if case is passing else []  # what failed, but isn't predicted
    np.testing.assert_array_equal(of(frame, "/virtual/psi")[1], angle)


def breaks(path, entity):
    """Return the times of the rows that hold no value."""
    from rerun.chunk import RrdReader

    times = []
    for chunk in RrdReader(path).stream().filter(content=[entity]):
        batch = chunk.to_record_batch()
        if "Scalars:scalars" in batch.schema.names:
            empty = [len(row) == 0 for row in batch.column("Scalars:scalars").to_pylist()]
            times += [time.value / 1e9 for time, is_empty in zip(batch.column("time"), empty, strict=True) if is_empty]
    return sorted(times)


def test_no_line_runs_over_a_gap(recorded):
    path = recorded(jammed)
    assert breaks(path, "/sensors/rates/q") == pytest.approx([60.02, 140.02])
    assert breaks(path, "/sensors/rates/p") == pytest.approx([60.02, 100.0, 140.02])  # p misses two seconds
    for entity in ("/residuals/q", "/levels/q", "/virtual/q"):
        (between,) = breaks(path, entity)
        assert 139.0 < between < 146.5
    assert breaks(recorded(passing), "/sensors/rates/p") == []


def words_of(path, entity, component):
    from rerun.chunk import RrdReader

    rows = []
    for chunk in RrdReader(path).stream().filter(content=[entity]):
        batch = chunk.to_record_batch()
        if component in batch.schema.names and "time" in batch.schema.names:
            texts = [row[0] for row in batch.column(component).to_pylist()]
            rows += list(zip((time.value / 1e9 for time in batch.column("time")), texts, strict=True))
    return rows


def test_the_recording_tells_what_happened_when(recorded, read):
    path, watched = recorded(jammed), jammed()
    missing, alarm = watched.alarms
    told = dict(words_of(path, "/events", "TextLog:text")[::-1])
    texts = [text for _, text in words_of(path, "/events", "TextLog:text")]
    assert all(
        any(told.text in text and f"{told.start_s:.2f} s  remark" in text for text in texts)
        for told in watched.log.remarks
    )
    assert f"{alarm.time_s:.2f} s  alarm: residual of q ({alarm.test})" in texts
    assert any("q failed; jam" in text for text in texts)
    assert f"{missing.time_s:.2f} s  alarm: missing samples of p" in texts
    assert f"{missing.time_s:.2f} s  p failed; dropout" in texts
    assert f"{missing.end_known_s:.2f} s  the fault has gone, since {missing.ended_s:.2f} s" in texts
    assert told[239.0] == f"239.00 s  outcome: {verdict_text(watched)}"
    for sensor in watched.verdict.scope.sensors:
        states = words_of(path, f"/state/{sensor}", "StateChange:state")
        spans = watched.timeline.sensors[sensor]
        assert states[:-1] == [(pytest.approx(span.start_s), span.state.value) for span in spans]
        assert states[-1][1] == ""
    frame = read(jammed)
    for entity, times in (("/alarm", "time_s"), ("/named", "isolated_s")):
        assert of(frame, entity)[0] == pytest.approx([getattr(missing, times), getattr(alarm, times)])


def test_the_recording_holds_outcome_and_findings_for_programs(read):
    frame, results = read(jammed), log_results(jammed())
    verdict = frame[frame.entity == "/verdict"].set_index("series")
    assert (verdict.text["verdict"], verdict.value["exit_code"]) == (results["verdict"], 1.0)
    assert verdict.value["watched_hours"] == results["watched_hours"]
    for number, row in enumerate(results["findings"], 1):
        fields = frame[frame.entity == f"/findings/{number}/verdict"].set_index("series")
        assert (fields.value["alarm_s"], fields.text["sensor"]) == (row["alarm_s"], row["sensor"])
    assert not (frame.entity == "/findings/3/verdict").any()


@pytest.mark.parametrize("case", by_day([odd, unwatched, normed, standing, silent], 0))
def test_logs_of_any_names_and_lengths_are_recorded_without_a_word(case, read, tmp_path, capfd):
    write_log_recording(case(), tmp_path / "log.rrd")
    assert capfd.readouterr().err == ""  # rerun warns of entity paths that aren't escaped
    assert set(case().log.channels) <= set(read(case).series)


def test_what_failed_is_shown_before_what_only_alarmed():
    alarms = [SimpleNamespace(sensor=sensor, time_s=time_s) for sensor, time_s in ((None, 1.0), ("r", 2.0), ("q", 3.0))]
    verdict = SimpleNamespace(failed=[("q", None)])
    assert [alarm.time_s for alarm in failed_first(verdict, alarms)] == [3.0, 1.0, 2.0]
