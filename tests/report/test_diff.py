"""Two recordings compared: equal runs are equal, one bit is found, and what is laid over each other is both."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.report.recording.diff import Closeness, compare
from gtmbench.report.recording.overlay import _summary, write_overlay
from gtmbench.report.recording.write import write_recording
from tests.cli.test_cli import SHORT
from tests.helpers.hostile import refused
from tests.helpers.night import by_day


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """Recordings of seed 1, of seed 1 again, and of seed 2."""
    folder = tmp_path_factory.mktemp("recordings")
    (folder / "short.toml").write_text(SHORT)
    for name, seed in (("one", 1), ("again", 1), ("two", 2)):
        write_recording(gb.run_study([gb.load_scenario(folder / "short.toml")], seed=seed), folder / f"{name}.rrd")
    return {path.stem: path for path in folder.glob("*.rrd")}


read_recording = gb.read_recording  # as it is where nobody has put another in its place


class Frames(dict):
    """Recordings that are read when they are first asked for, which takes a process."""

    def __init__(self, paths):
        self.paths = paths

    def __missing__(self, name):
        return self.setdefault(name, read_recording(self.paths[name]))


@pytest.fixture(scope="module")
def frames(paths):
    return Frames(paths)


@pytest.fixture
def read_already(frames, monkeypatch):
    """Let the command line have what was read of the recordings."""
    monkeypatch.setattr("gtmbench.report.recording.read.read_recording", lambda path: frames[path.stem])


def line(values, series="p", entity="/sensors/rates"):
    values = np.asarray(values, dtype=float)
    time_s = np.arange(len(values)) / 100.0
    return pd.DataFrame({"entity": entity, "series": series, "time_s": time_s, "value": values, "text": None})


def told(rows, entity="/events"):
    return pd.DataFrame(rows, columns=["series", "time_s", "value", "text"]).assign(entity=entity)


@pytest.mark.nightly
def test_two_runs_of_one_seed_are_equal(cli, paths, frames):
    assert paths["one"].read_bytes() != paths["again"].read_bytes()
    code, out, err = cli("verify", paths["one"], "--against", paths["again"])
    assert (code, err) == (0, "")
    assert out.startswith("Equal: ")
    comparison = compare(frames["one"], frames["again"])
    names = frames["one"].groupby(["entity", "series"], observed=True).size().reset_index()
    verdicts = names.entity.astype(str).str.endswith("/verdict")
    assert (comparison.series, comparison.fields) == ((~verdicts & (names.entity != "/events")).sum(), verdicts.sum())
    assert comparison.events == (frames["one"].entity == "/events").sum() == 5
    assert comparison.equal


@pytest.mark.usefixtures("read_already")
def test_another_seed_differs_in_what_is_noisy_and_nowhere_else(cli, paths, frames):
    code, out, err = cli("verify", paths["one"], "--against", paths["two"], "--json")
    comparison = json.loads(out)
    assert (code, err, comparison["equal"]) == (1, "", False)
    differing = {(series["entity"], series["series"]): series for series in comparison["lines"]}
    assert ("/sensors/rates", "p") in differing
    assert ("/trials/short/r/residual", "r") in differing
    assert not [entity for entity, _ in differing if entity.startswith(("/truth", "/path", "/attitude", "/surfaces"))]
    a, b = (frames[name][frames[name].entity == "/trials/short/r/residual"] for name in ("one", "two"))
    distance = np.abs(a.value.to_numpy() - b.value.to_numpy())
    at, worst = int(np.argmax(distance)), differing["/trials/short/r/residual", "r"]
    assert worst["worst"] == {
        "at": a.time_s.iloc[at],
        "a": a.value.iloc[at],
        "b": b.value.iloc[at],
        "difference": distance[at],
    }
    assert worst["relative"] == distance[at] / max(a.value.abs().max(), b.value.abs().max())
    assert {verdict["field"] for verdict in comparison["verdicts"]} >= {"threshold", "peak_ratio"}
    relative = [np.inf if series["relative"] is None else series["relative"] for series in comparison["lines"]]
    assert relative == sorted(relative, reverse=True)


@pytest.mark.usefixtures("read_already")
def test_the_table_says_what_differs_and_shortens_long_lists(cli, paths):
    code, out, _ = cli("verify", paths["one"], "--against", paths["two"])
    assert code == 1
    assert "Series that differ, the worst first" in out
    assert " more; --json lists all" in out
    assert "/trials/short/r/verdict   peak_ratio" in out
    assert out.startswith("Different: ")
    quiet = cli(
        "verify", paths["one"], "--against", paths["two"], "-q", "--absolute", 1e9
    )  # words and times have no tolerance
    assert quiet == (1, "", "")


@settings(max_examples=30)
@given(data=st.data())
def test_one_changed_bit_in_one_sample_is_found_with_its_time(frames, data):
    frame = frames["one"][frames["one"].entity.str.startswith("/trials")]
    numbers = np.flatnonzero(frame.value.notna() & frame.time_s.notna())
    at = int(numbers[data.draw(st.integers(0, len(numbers) - 1))])
    values = frame.value.to_numpy(copy=True)
    values.view(np.int64)[at] ^= np.int64(1) << data.draw(st.integers(0, 62))
    comparison = compare(frame, frame.assign(value=values))
    (differs,) = comparison.lines
    row = frame.iloc[at]
    assert (differs.entity, differs.series, differs.worst.at) == (row.entity, row.series, row.time_s)
    assert (differs.differing, differs.only_a, differs.only_b) == (1, 0, 0)
    np.testing.assert_array_equal([differs.worst.a, differs.worst.b], [row.value, values[at]])
    assert comparison.verdicts == comparison.told == comparison.only_a == comparison.only_b == ()


# of two bytes, all of them: NaN, infinities, both zeros; st.floats(width=16) filters so much that some runs are refused
FLOATS = st.integers(0, 0xFFFF).map(lambda bits: float(np.uint16(bits).view(np.float16)))


@settings(max_examples=settings().max_examples // 4)
@given(st.lists(st.tuples(FLOATS, FLOATS), min_size=1), st.floats(0.0, 10.0))
def test_values_within_the_tolerance_are_equal_and_no_others(pairs, absolute):
    a, b = np.array(pairs).T
    comparison = compare(line(a), line(b), Closeness(absolute=absolute))

    def alike(x, y):
        both = str(x) == str(y)  # tells -0.0 from 0.0, and no NaN from another
        return both or (absolute > 0.0 and np.isfinite([x, y]).all() and abs(x - y) <= absolute)

    expected = sum(not alike(x, y) for x, y in pairs)
    assert sum(series.differing for series in comparison.lines) == expected
    mirrored = compare(line(b), line(a), Closeness(absolute=absolute))
    assert sum(series.differing for series in mirrored.lines) == expected
    assert compare(line(a), line(a)).equal


def test_a_relative_tolerance_is_of_the_series_greatest_magnitude():
    a, b = line([0.0, -100.0, 1.0]), line([0.0, -100.0, 2.0])
    assert compare(a, b).lines[0].relative == 0.01
    assert compare(a, b, Closeness(relative=0.01)).equal
    assert not compare(a, b, Closeness(relative=0.0099)).equal


def test_samples_that_one_lacks_are_counted_and_the_others_held_against_each_other():
    a, b = line([1.0, 2.0, 3.0, 4.0, 5.0]), line([1.0, 2.0, 3.5, 4.0, 5.0])
    (series,) = compare(a.drop(index=0), b.drop(index=[3, 4])).lines
    assert (series.samples, series.differing, series.only_a, series.only_b) == (2, 1, 2, 1)
    assert (series.worst.at, series.worst.a, series.worst.b, series.relative) == (0.02, 3.0, 3.5, np.inf)
    (moved,) = compare(a.iloc[:1], a.iloc[1:2], Closeness(absolute=10.0)).lines
    assert (moved.samples, moved.worst, moved.only_a, moved.only_b) == (0, None, 1, 1)


def test_series_verdicts_and_events_of_one_only():
    none = float("nan")
    events = [("INFO", 1.0, none, "it begins"), ("ERROR", 2.0, none, "alarm"), ("ERROR", 2.0, none, "alarm")]
    verdict = [("alarm_time_s", none, 5.0, None), ("kind", none, none, "jam"), ("sensor", none, none, None)]
    a = pd.concat([line([1.0]), told(events), told(verdict, "/trials/x/p/verdict")])
    now = [("alarm_time_s", none, none, None), ("kind", none, none, "drift"), ("extra", none, 1.0, None)]
    b = pd.concat([line([1.0], "q"), told(events[:2]), told(now, "/trials/x/p/verdict")])
    comparison = compare(a, b)
    assert comparison.only_a == (("/sensors/rates", "p"), ("/trials/x/p/verdict", "sensor"))
    assert comparison.only_b == (("/sensors/rates", "q"), ("/trials/x/p/verdict", "extra"))
    assert [tuple(row[key] for key in ("field", "a", "b")) for row in comparison.verdicts] == [
        ("alarm_time_s", 5.0, None),
        ("kind", "jam", "drift"),
    ]
    assert [(row["only_in"], row["time_s"], row["level"], row["text"]) for row in comparison.told] == [
        ("A", 2.0, "ERROR", "alarm")
    ]
    assert comparison.events == 2


BAD = {
    "no such file": (["one.rrd", "nowhere.rrd"], "nowhere.rrd: no such file"),
    "garbage": (["garbage.rrd", "one.rrd"], "garbage.rrd isn't a whole rerun recording"),
    "tolerance": (["one.rrd", "one.rrd", "--tolerance", "-1"], "--tolerance is -1; it must be"),
    "infinite": (["one.rrd", "one.rrd", "--absolute", "inf"], "--absolute is inf"),
    "ending": (["one.rrd", "one.rrd", "--overlay", "over.txt"], "its name ends in .rrd"),
    "exists": (["one.rrd", "one.rrd", "--overlay", "garbage.rrd"], "give another --overlay, or --force"),
    "itself": (["one.rrd", "one.rrd", "--overlay", "one.rrd", "--force"], "which is read; give another name"),
    "no folder": (["one.rrd", "one.rrd", "--overlay", "no/over.rrd"], "doesn't exist"),
}


@pytest.mark.parametrize("name", by_day(BAD))
def test_bad_input_is_one_line_and_exit_code_2(cli, name, paths, tmp_path):
    (tmp_path / "one.rrd").write_bytes(paths["one"].read_bytes())
    (tmp_path / "garbage.rrd").write_bytes(b"garbage")
    arguments, message = BAD[name]
    assert message in refused(cli("verify", arguments[0], "--against", *arguments[1:]))
    assert {path.name for path in tmp_path.iterdir()} == {"one.rrd", "garbage.rrd"}
    assert (tmp_path / "one.rrd").read_bytes() == paths["one"].read_bytes()


@pytest.mark.nightly
@pytest.mark.usefixtures("read_already")
def test_an_overlay_holds_both_and_their_differences(cli, paths, frames, tmp_path):
    code, out, err = cli("verify", paths["one"], "--against", paths["two"], "--overlay", "over.rrd")
    assert (code, err) == (1, "")
    assert "gtmbench view over.rrd" in out
    over = gb.read_recording(tmp_path / "over.rrd")

    def held(frame, entity):
        return frame[frame.entity == entity].value.to_numpy()

    a, b = held(frames["one"], "/trials/short/r/norm"), held(frames["two"], "/trials/short/r/norm")
    np.testing.assert_array_equal(held(over, "/A/trials/short/r/norm/norm"), a)
    np.testing.assert_array_equal(held(over, "/B/trials/short/r/norm/norm"), b)
    np.testing.assert_array_equal(held(over, "/difference/trials/short/r/norm/norm"), b - a)
    np.testing.assert_array_equal(held(over, "/both/truth/speed/tas"), held(frames["one"], "/truth/speed"))
    assert len(held(over, "/A/truth/speed/tas")) == 0
    texts = over[over.entity == "/events"].text.astype(str)
    assert {text.split(":")[0] for text in texts} == {"both", "only A", "only B"}


@pytest.mark.nightly
def test_an_overlay_of_equal_recordings_and_of_recordings_without_a_common_series(tmp_path, frames):
    write_overlay(frames["one"], frames["again"], compare(frames["one"], frames["again"]), tmp_path / "equal.rrd")
    equal = gb.read_recording(tmp_path / "equal.rrd")
    assert {entity.split("/")[1] for entity in equal.entity.cat.categories} == {"both", "events"}
    a, b = line([1.0, 2.0], "a b/c"), line([1.0], "q", "/other")
    write_overlay(a, b, compare(a, b), tmp_path / "strange.rrd")
    strange = gb.read_recording(tmp_path / "strange.rrd")
    assert list(strange.value) == [1.0, 2.0, 1.0]
    b = line([1.0, 2.0], "a b/c").assign(time_s=[7.0, 8.0])  # no difference anywhere: there is no common time
    write_overlay(a, b, compare(a, b), tmp_path / "apart.rrd")
    assert list(gb.read_recording(tmp_path / "apart.rrd").value) == [1.0, 2.0, 1.0, 2.0]


def test_what_others_recordings_call_things_is_no_markdown():
    """Whoever wrote a recording fetches no picture and sets no link by the names in it."""
    hostile = "![x](https://example.org/x.png) <img src=x> `|"
    a, b = (line([1.0, value], hostile, f"/{hostile}") for value in (2.0, 3.0))
    told_a, told_b = (
        told([(hostile, np.nan, np.nan, f"{word}{hostile}")], entity=f"/{hostile}/verdict") for word in ("a", "b")
    )
    comparison = compare(pd.concat([a, told_a]), pd.concat([b, told_b]))
    assert comparison.lines
    assert comparison.verdicts
    page = _summary(comparison, (hostile, hostile))
    assert page.count("example.org") == 7  # two names, a series, a field with its values
    assert not {*re.findall(r"\]\(|<|`", page)}
