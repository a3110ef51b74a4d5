"""What the engine found, in words and values: who did it, how likely that is, what shows it, why it names nobody."""

from functools import cache
from tempfile import TemporaryDirectory

import pytest

import gtmbench as gb
from gtmbench.report.page.flight import flight_page
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.found import COLUMNS, finding_lines, finding_rows
from tests.helpers import monitors

BIAS = gb.Bias(channel="r", onset_s=60.0, size=3.0)


@cache
def watched(*, is_broken=True):
    record = monitors.record(6000, seed=3).select(("p", "q", "r", "phi", "theta", "psi"))
    with TemporaryDirectory() as folder:
        gb.write_log(gb.inject(record, BIAS) if is_broken else record, f"{folder}/flight.csv")
        told = gb.watch_log(f"{folder}/flight.csv", "auto", attitude="own")
        return told, flight_page(told, "gtmbench monitor flight.csv"), log_results(told)


@pytest.mark.nightly
def test_a_failure_stands_with_its_explanations_and_what_shows_it():
    (row,) = finding_rows(watched()[0].judged)
    said = dict(zip(COLUMNS, row, strict=True))
    assert float(said["from (s)"]) == pytest.approx(BIAS.onset_s, abs=2.0)
    assert said["what"].startswith("r: bias ")
    assert said["how likely"].startswith("bias of r over 99 %")
    assert said["shown by"].startswith("r less the attitude's rate (")
    assert said["why it names nobody"] == ""
    head, first, *rest = finding_lines(watched()[0].judged)
    assert "over the whole log" in head
    assert first.split() == [row[0], "to", row[1], *row[2].split()]
    assert [line.split(":")[0].strip() for line in rest] == ["how likely", "shown by"]
    assert "r less the attitude&#39;s rate, and predicted for bias of r" in watched()[1]
    assert "What explains gyros and attitude over the whole log" in watched()[1]


@pytest.mark.nightly
def test_where_nothing_was_found_nothing_is_said():
    assert finding_lines(watched(is_broken=False)[0].judged) == finding_lines(None) == []
    assert "What explains gyros" not in watched(is_broken=False)[1]


@pytest.mark.nightly
def test_chances_are_a_distribution_and_the_curve_follows_its_prediction():
    told, _, results = watched()
    (found,) = results["explained"]
    chances = [each["probability"] for each in found["explanations"]]
    assert chances == sorted(chances, reverse=True)
    assert 0.99 < sum(chances) <= 1.0 + 1e-12
    assert (found["names"], found["doubt"]) == ("r", "")
    curve = told.judged.curves[0]
    after = curve.time_s > BIAS.onset_s + 3.0
    assert curve.measured[after].mean() == pytest.approx(BIAS.size, abs=0.3)
    assert curve.predicted[after].mean() == pytest.approx(BIAS.size, abs=0.3)
    assert abs(curve.measured[curve.time_s < BIAS.onset_s - 3.0].mean()) < 0.3
