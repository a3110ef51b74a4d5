"""Entries are files that anybody may have written: what is wrong with one is said in one line."""

import shutil

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.study.benchmark.definition import CALIBRATION, TEST
from gtmbench.study.benchmark.entry import read_entry
from tests.helpers.night import by_day
from tests.helpers.small_benchmark import describe, finds, noise_of, tiny, write_scores


@pytest.fixture(scope="module")
def definition(tmp_path_factory):
    return tiny(tmp_path_factory.mktemp("definition"))


@pytest.fixture(scope="module")
def written(tmp_path_factory, definition):
    return write_scores(tmp_path_factory.mktemp("entry") / "mine", definition, TEST, finds, channels=("p", "q", "r"))


@pytest.fixture
def folder(tmp_path, written):
    return shutil.copytree(written, tmp_path / "mine")


def first(definition, folder, split=TEST):
    flight = next(iter(definition.flights(split)))
    return flight, folder / f"{flight.path}.csv"


def read_all(folder, definition):
    entry = read_entry(folder, definition, TEST)
    for split in (CALIBRATION, TEST):
        for flight in definition.flights(split):
            entry.scores(flight)
    return entry


def test_a_good_one_is_read(folder, definition):
    describe(folder, definition, 'title = "mine"\nmicroseconds_a_sample = 3\n')
    entry = read_all(folder, definition)
    assert (entry.facts.name, entry.facts.title, entry.facts.microseconds_a_sample) == ("mine", "mine", 3.0)
    assert list(entry.scores(next(iter(definition.flights(TEST)))).by_channel) == ["p", "q", "r"]


def test_parquet_is_as_good(tmp_path, folder, definition):
    other = write_scores(tmp_path / "other", definition, TEST, finds, suffix=".parquet")
    flight, _ = first(definition, folder)
    scores = [read_all(each, definition).scores(flight).score for each in (folder, other)]
    assert np.allclose(*scores)


def spoil(column, row, value):
    def spoilt(path):
        frame = pd.read_csv(path)
        frame[column] = frame[column].astype(object)
        frame.loc[row, column] = value
        frame.to_csv(path, index=False)

    return spoilt


def reordered(path):
    pd.read_csv(path).iloc[::-1].to_csv(path, index=False)


def shortened(path):
    pd.read_csv(path).iloc[:-5].to_csv(path, index=False)


def huge(path):
    with path.open("r+b") as file:
        file.truncate(10 * 2**30)  # sparse: ten gigabytes that take no room


BAD = {
    "missing": (
        lambda path: path.unlink(),
        r"1 of 24 flights have no score file, gtm/test/.*\.csv the first; write one",
    ),
    "nan": (spoil("score", 6, np.nan), r"\.csv: score is nan in row 7; where there is no score, write the least one"),
    "infinite": (spoil("score", 6, np.inf), "score is inf in row 7"),
    "text": (spoil("score", 6, "high"), "column score isn't all numbers"),
    "nan by channel": (spoil("score_p", 0, np.nan), "score_p is nan in row 1"),
    "unsorted": (
        reordered,
        "time_s is 40 in row 1 where the flight has 0; write the flight's own times, in their order",
    ),
    "other times": (spoil("time_s", 3, 0.5), "time_s is 0.5 in row 4 where the flight has 0.03"),
    "short": (shortened, "it has 3996 rows and the flight 4001; write one score a sample"),
    "column": (lambda path: path.write_text("time_s,scor\n0,1\n"), "unknown column 'scor'.*did you mean 'score'"),
    "no score": (lambda path: path.write_text("time_s\n0\n"), "it has no column score"),
    "empty": (lambda path: path.write_text(""), "isn't a readable csv table"),
    "ragged": (
        lambda path: path.write_text("time_s,score\n0,1\n0.01,2,3\n"),
        "isn't a readable csv table|rows and the",
    ),
    "binary": (lambda path: path.write_bytes(bytes(range(256)) * 20), "isn't a readable csv table|unknown column"),
    "ten gigabytes": (huge, r"has 10737418240 bytes; a score file of 4001 rows has at most"),
}


@pytest.mark.parametrize("case", by_day(BAD, 3))
def test_what_is_wrong_is_said_in_one_line(folder, definition, case):
    spoilt, said = BAD[case]
    spoilt(first(definition, folder)[1])
    with pytest.raises(gb.InputError, match=said) as caught:
        read_all(folder, definition)
    assert "\n" not in str(caught.value)


def test_a_file_that_leads_out_of_the_folder_is_refused(tmp_path, folder, definition):
    _, path = first(definition, folder)
    outside = tmp_path / "elsewhere.csv"
    path.rename(outside)
    path.symlink_to(outside)
    with pytest.raises(gb.InputError, match="leads out of the folder"):
        read_all(folder, definition)


def test_a_file_of_no_flight_is_refused(folder, definition):
    _, path = first(definition, folder)
    path.with_stem("zzz").write_text("time_s,score\n")
    with pytest.raises(gb.InputError, match=r"zzz.csv: no flight of tiny is called so"):
        read_entry(folder, definition, TEST)


def test_what_is_no_folder_is_refused(tmp_path, definition):
    with pytest.raises(gb.InputError, match="no such file"):
        read_entry(tmp_path / "none", definition, TEST)
    (tmp_path / "file").write_text("")
    with pytest.raises(gb.InputError, match="is no folder"):
        read_entry(tmp_path / "file", definition, TEST)


def centred(flight, time_s):
    """A mean over a second before and after: it sees a second of the future."""
    return np.convolve(noise_of(flight, time_s), np.ones(201) / 201.0, mode="same")


def whitened(flight, time_s):
    """Scores over the deviation of the whole flight."""
    return finds(flight, time_s) / finds(flight, time_s).std()


def drawn(_, time_s):
    return np.random.default_rng().normal(size=len(time_s))


@pytest.mark.parametrize("score", by_day([centred, whitened, drawn]))
def test_a_score_that_sees_the_future_is_found(tmp_path, definition, score):
    folder = write_scores(tmp_path / "mine", definition, TEST, score)
    with pytest.raises(gb.InputError, match=r"it sees the future, or draws random numbers: score of gtm/test/\w+ at"):
        read_entry(folder, definition, TEST)


def table(folder, text, definition):
    folder.mkdir(exist_ok=True)
    (folder / "alarms.csv").write_text(text)
    describe(folder, definition)
    return folder


def test_a_table_of_alarms_is_read(tmp_path, definition):
    flight = next(iter(definition.flights(TEST)))
    entry = read_entry(
        table(tmp_path / "a", f"flight,time_s,sensor\n{flight.id},9.5,p|phi\n{flight.id},3,\n", definition),
        definition,
        TEST,
    )
    assert entry.alarms[flight.id] == [(3.0, ()), (9.5, ("p", "phi"))]


def test_alarms_that_differ_in_a_flight_that_is_cut_short_are_found(tmp_path, definition):
    twin = next(each for each in definition.flights(TEST) if each.twin)
    with pytest.raises(gb.InputError, match=r"it sees the future.*alarms of gtm/test"):
        read_entry(table(tmp_path / "a", f"flight,time_s\n{twin.twin},3\n", definition), definition, TEST)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("flight,time_s\n../../secret,3\n", r"no flight is called '\.\./\.\./secret'"),
        ("flight,time_s\nFLIGHT,99\n", "flight .*: time_s is 99.0; it must be a finite number, 0 or more, at most 40"),
        ("flight,time_s\nFLIGHT,nan\n", "flight .*: time_s is nan; it must be a finite number"),
        ("flight,time_s\nFLIGHT,soon\n", "time_s is 'soon'; it must be seconds"),
        ("flight,time_s,sensor\nFLIGHT,3,gyro\n", "no sensor is called 'gyro'"),
        ("flight,when\nFLIGHT,3\n", "unknown key 'when'; its columns are flight, time_s, sensor"),
        ("flight\nFLIGHT\n", "it has no column time_s"),
        ("", "isn't a readable csv table"),
    ],
)
def test_a_bad_table_is_refused_in_one_line(tmp_path, definition, rows, said):
    flight = next(iter(definition.flights(TEST)))
    with pytest.raises(gb.InputError, match=said) as caught:
        read_entry(table(tmp_path / "a", rows.replace("FLIGHT", flight.id), definition), definition, TEST)
    assert "\n" not in str(caught.value)


def test_a_bad_description_is_refused(folder, definition):
    (folder / "entry.toml").write_text("bond = 1\n")
    with pytest.raises(gb.InputError, match=r"unknown key 'bond'.*did you mean 'bound'"):
        read_entry(folder, definition, TEST)
