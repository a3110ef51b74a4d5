"""What README and docs say of a run is what its results hold."""

import argparse
import json

import pytest

from studies.conduct import DETAILS, write_report
from tests.helpers.scripts import script

FIGURES = script("figures")
PAGES = {path.name: path for path in FIGURES["pages"]() if "<!-- figures:" in path.read_text(encoding="utf-8")}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_says_what_the_results_do(name):
    page = PAGES[name].read_text(encoding="utf-8")
    assert FIGURES["filled"](page) == page, "run make figures"


def test_every_figure_stands_somewhere():
    together = "".join(path.read_text(encoding="utf-8") for path in PAGES.values())
    assert [name for name in FIGURES["FIGURES"] if f"<!-- figures: {name} -->" not in together] == []


REPORTS = sorted(path.parent for path in (FIGURES["HERE"] / "reports").glob("*/report.md"))


@pytest.mark.parametrize("folder", [each for each in REPORTS if each.name != "gtmbench-2"], ids=lambda each: each.name)
def test_a_report_has_results_that_say_what_made_them(folder):
    """gtmbench-2's says it itself. A run that is older than the digests says when it was."""
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert results["tables"]
    assert "command" in results or {"script", "given"} <= set(results)
    source = results["code"]["source"]
    assert len(source) == 16 if source else results["date"] > "2026-11-01"


def test_a_table_of_a_report_is_shown_with_the_run_that_made_it():
    page = FIGURES["filled"]("<!-- figures: table chained_gains 1 --><!-- end -->")
    rows = json.loads((FIGURES["HERE"] / "reports/chained_gains/results.json").read_text())
    lines = [line for line in page.splitlines() if line.startswith("| ")]
    assert len(lines) == 2 + len(rows["tables"][0])
    assert all(f" {row['RMS q (deg/s)']} " in line for row, line in zip(rows["tables"][0], lines[2:], strict=True))
    assert rows["code"]["source"][:8] in page


def test_details_stand_in_the_results_alone(tmp_path):
    text = f"# Report\n\n| a |\n|---|\n| 1 |\n\n{DETAILS}\n\n| b |\n|---|\n| 2 |\n"
    write_report(tmp_path, text, argparse.Namespace(out=tmp_path))
    assert json.loads((tmp_path / "results.json").read_text())["tables"] == [[{"a": "1"}], [{"b": "2"}]]
    report = (tmp_path / "report.md").read_text()
    assert "| 1 |" in report
    assert "| 2 |" not in report
    assert "results.json" in report


def test_a_report_has_its_tables_beside_it_and_what_made_them(tmp_path):
    """Logs don't ship: their digest changes with any byte of them, and with nothing else."""
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "a.csv").write_text("1")
    given = argparse.Namespace(out=tmp_path, folders=[logs], seed=3)

    def results():
        write_report(tmp_path, "# Report\n\n| fault | share |\n|---|---|\n| jam | 0.9 |\n", given)
        return json.loads((tmp_path / "results.json").read_text())

    first, again = results(), results()
    assert first == again
    assert first["tables"] == [[{"fault": "jam", "share": "0.9"}]]
    assert (first["given"], list(first["logs"])) == ({"folders": ["logs"], "seed": 3}, ["logs"])
    assert "source" in first["code"]
    (logs / "a.csv").write_text("2")
    assert results()["logs"] != first["logs"]
