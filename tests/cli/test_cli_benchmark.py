"""`gtmbench benchmark` as a stranger uses it: flights out, scores back, one table; bad input in one line."""

import csv
import json
import zipfile
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import gtmbench as gb
from gtmbench.study.benchmark.definition import PRIVATE, TEST, load_definition, with_secret
from tests.helpers.hostile import refused
from tests.helpers.small_benchmark import finds, tiny, write_scores

SQUARED = """
import gtmbench as gb
import numpy as np


class Squared(gb.ScoreDetector):
    name, channels, memory_s = "squared", ("p", "q", "r"), 0.0

    def learn(self, records):
        return {name: float(np.nanstd(np.concatenate([one[name] for one in records]))) for name in self.channels}

    def scores(self, record, deviations):
        return {name: (record[name] / deviations[name]) ** 2 for name in self.channels}
"""


@pytest.fixture(autouse=True)
def definition(tmp_path, monkeypatch):
    found = tiny(tmp_path)
    monkeypatch.setattr(
        "gtmbench.study.benchmark.definition.shipped_benchmarks", lambda: {"gtmbench-2": tmp_path / "tiny.toml"}
    )
    return found


def awk_like(folder, out):
    """Score every exported flight by its rows alone, as a script in any language would: no gtmbench in it."""
    with (folder / "flights.csv").open() as file:
        flights = [row for row in csv.DictReader(file) if row["split"] != "learn"]
    for flight in flights:
        place = f"{flight['group']}/{flight['split']}/{flight['flight']}.csv"
        (out / place).parent.mkdir(parents=True, exist_ok=True)
        with (folder / place).open() as file, (out / place).open("w") as to:
            to.write("time_s,score\n")
            for row in csv.DictReader(file):
                rate = row["p_deg_s"]
                to.write(f"{row['time_s']},{float(rate) ** 2 if rate else 0.0}\n")


@pytest.mark.nightly
def test_flights_go_out_scores_come_back_and_a_table_is_made(cli, tmp_path):
    code, said, _ = cli("benchmark", "--export", "flights", "--csv", "--jobs", "1")
    assert (code, said) == (0, "Wrote 28 flights of tiny, split test: flights.\n")
    assert "CC0 1.0" in (tmp_path / "flights/LICENCE.txt").read_text()
    everything = " ".join(path.read_text() for path in (tmp_path / "flights").glob("*.*"))
    assert not any(word in everything for word in ("bias", "onset", "jam"))
    awk_like(tmp_path / "flights", tmp_path / "squares")
    line = ("benchmark", "--score", "squares", "--out", "table", "--jobs", "1", "--quiet", "--archive", "run.zip")
    assert "squares: it names no definition, and that of tiny is" in refused(cli(*line))
    (tmp_path / "squares/entry.toml").write_bytes((tmp_path / "flights/entry.toml").read_bytes())
    code, _, err = cli(*line)
    assert (code, err) == (0, "")
    results = json.loads((tmp_path / "table/results.json").read_text())
    schema = json.loads((Path(gb.__file__).parent / "benchmarks/results.schema.json").read_text())
    jsonschema.validate(results, schema)
    with zipfile.ZipFile(tmp_path / "run.zip") as packed:
        assert {"tiny/results.json", "tiny/report.md", "tiny/CITATION.cff"} <= set(packed.namelist())
    assert {row["name"] for row in results["rows"][:2]} == {"reference", "oracle"}
    assert "squares" in [row["name"] for row in results["rows"]]
    page = (tmp_path / "table/report.md").read_text()
    assert all(word in page for word in ("Quickness", "Data sheet", "What it doesn't", "| squares"))
    assert "type: dataset" in (tmp_path / "table/CITATION.cff").read_text()
    assert (tmp_path / "table/curves.png").stat().st_size > 10_000


@pytest.mark.nightly
def test_exported_flights_are_the_benchmarks_and_an_export_goes_on(cli, tmp_path, definition):
    assert cli("benchmark", "--export", "flights", "--jobs", "1")[0] == 0
    flight = next(iter(definition.flights(TEST)))
    path = tmp_path / f"flights/{flight.path}.parquet"
    before = gb.read_log(path)
    path.unlink()
    assert cli("benchmark", "--export", "flights", "--jobs", "1")[0] == 0
    assert np.array_equal(gb.read_log(path).values, before.values, equal_nan=True)
    code, _, err = cli("benchmark", "--export", "flights", "--split", "development", "--jobs", "1")
    assert (code, err) == (2, "gtmbench: flights holds other flights, by its README.txt; give another folder\n")


@pytest.mark.nightly
def test_a_detector_of_a_dozen_lines_enters(cli, tmp_path):
    (tmp_path / "mine.py").write_text(SQUARED)
    line = ("benchmark", "--detector", "mine.py:Squared", "--out", "table", "--jobs")
    code, _, err = cli(*line, "2", "--quiet")  # which other processes have to know
    assert (code, err) == (0, "")
    assert "squared" in (tmp_path / "table/report.md").read_text()
    (tmp_path / "mine.py").write_text(SQUARED.replace("** 2", "** 4"))  # its scores would be the old ones
    assert "holds another run" in refused(cli(*line, "1"))


@pytest.mark.nightly
def test_a_private_split_is_judged_by_its_secret_alone(cli, tmp_path, definition):
    (tmp_path / "seed").write_bytes(b"a secret, of more than sixteen bytes")
    private = with_secret(definition, tmp_path / "seed")
    write_scores(tmp_path / "mine", private, PRIVATE, finds)
    line = ("benchmark", "--score", "mine", "--private-seed", "seed", "--out", "table", "--jobs", "1", "--json")
    code, said, _ = cli(*line)
    told = json.loads(said)
    assert (code, told["split"], len(told["private_seed"])) == (0, "private", 64)
    row = next(row for row in told["rows"] if row["name"] == "mine")
    assert row["detected"] == row["flights"] == 6
    assert "flights have no score file" in refused(cli("benchmark", "--score", "mine", "--out", "other", "--jobs", "1"))


def test_files_of_another_definition_are_refused_in_one_line(cli, tmp_path, definition):
    folder = write_scores(tmp_path / "mine", definition, TEST, finds)
    (folder / "entry.toml").write_text(f'definition = "{"eb081dc7c72c04d0" * 4}"\n')  # that of gtmbench-1
    assert "its definition is 'eb081dc7c72c04d0', and that of tiny is" in refused(
        cli("benchmark", "--score", "mine", "--out", "table", "--jobs", "1")
    )


def test_a_score_file_that_lacks_a_flight_ends_with_one_line_and_nothing_written(cli, tmp_path, definition):
    folder = write_scores(tmp_path / "mine", definition, TEST, finds)
    next(folder.glob("gtm/test/*")).unlink()
    refused(cli("benchmark", "--score", "mine", "--out", "table", "--jobs", "1"))
    assert not (tmp_path / "table").exists()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("--export flights --score mine", "--export writes flights and judges nobody"),
        ("--score nowhere", "nowhere: no such file"),
        ("--private-seed nowhere", "nowhere: no such file"),
        ("--detector wind --jobs 1", "no detector is called 'wind'"),
        ("--jobs 0", "--jobs is 0"),
        ("--csv", "give --export DIR, too"),
    ],
)
def test_bad_input_ends_with_one_line(cli, line, said):
    assert said in refused(cli("benchmark", *line.split()))


@pytest.mark.nightly
def test_other_versions_are_refused_or_called_otherwise(cli, tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(path.read_text().replace("[versions]\n", '[versions]\nnumpy = "1.0"\n'))
    write_scores(tmp_path / "mine", load_definition(path), TEST, finds)
    line = ("benchmark", "--score", "mine", "--out", "table", "--jobs", "1")
    assert "this isn't tiny: there is numpy" in refused(cli(*line))
    code, said, _ = cli(*line, "--any-versions")
    assert code == 0
    assert said.startswith("not tiny: numpy")
    assert (tmp_path / "table/report.md").read_text().startswith("# not tiny: ")
