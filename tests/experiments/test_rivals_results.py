"""The report of the campaign of rivals says what its folder holds, and of an unfinished one nothing."""

import json

import pytest

import gtmbench as gb
from gtmbench.study.campaign.conduct import conduct
from tests.helpers.campaigns import loaded
from tests.helpers.scripts import script

RIVALS = script("rivals")


@pytest.mark.nightly
def test_results_are_those_of_the_folder_and_an_unfinished_one_is_refused(tmp_path):
    parts = conduct(loaded(tmp_path), tmp_path / "out")
    RIVALS["written"](tmp_path / "out", tmp_path / "report")
    results = json.loads((tmp_path / "report/results.json").read_text())
    (row,) = results["table"]
    assert row["detected"] == f"{parts.read().to_pandas()['detected'].sum()} of 32"
    assert results["code"] == parts.facts["versions"]
    assert "source" in results["code"]
    assert results["summary"] in (tmp_path / "report/report.md").read_text()
    (tmp_path / "out/part-000003.parquet").unlink()
    with pytest.raises(gb.InputError, match="lacks 1 of 8 flights"):
        RIVALS["written"](tmp_path / "out", tmp_path / "again")
    assert not (tmp_path / "again").exists()
