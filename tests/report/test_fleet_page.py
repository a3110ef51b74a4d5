"""The page of a fleet, of a few logs or of ten thousand, whatever they are called."""

import json
import re

import pytest

from gtmbench.report.fleet import fleet_page
from tests.helpers.browsers import looking_at

MOST_BYTES = 5e6
ROW = {
    "outcome": "healthy",
    "verdict": "No fault found in p, q, r, phi, theta, psi: 110 of 120 s judged; an error of 0.51 deg/s would show.",
    "certificate": "A bias above p 0.68, q 0.36, r 0.43 deg/s would have been detected within 10 s.",
    "judged_share": 0.9,
    "start_s": 0.0,
    "end_s": 120.0,
    "rate_hz": 100.0,
    "monitor": "auto",
    "watched_hours": 0.02,
    "alarms": 0,
    "doubtful_alarms": 0,
    "autopilot": None,
    "false_alarms_per_hour_at_most": 160.0,
    **{f"{gyro}_bias_seen_deg_s": 0.5 for gyro in "pqr"},
    "error": None,
}
HOSTILE = "</script><script>alert(1)</script>&amp;'\".csv"


def rows(count):
    named = [{**ROW, "log": f"flights/airframe_{at % 37}/log_{at}.ulg"} for at in range(count)]
    failed = {**ROW, "log": HOSTILE, "outcome": "failed", "verdict": "q failed: <b>bias</b>.", "alarms": 3}
    return [*named, failed]


def page_of(count):
    return fleet_page(rows(count), {HOSTILE: "pages/hostile.html"}, b"")


def test_the_page_of_ten_thousand_is_small_and_lacks_nothing():
    page = page_of(10_000)
    assert len(page.encode()) < MOST_BYTES
    data = json.loads(re.search(r'id="rows"[^>]*>(.*?)</script>', page)[1])
    assert [line[1] for line in data][:2] == [HOSTILE, "flights/airframe_0/log_0.ulg"]
    assert len(data) == 10_001
    assert page.count("<tr><td") == 200


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    path = tmp_path_factory.mktemp("fleet") / "fleet.html"
    path.write_text(page_of(1000))
    with looking_at(path) as look:
        yield look(1000)


def lines(tab):
    return tab.locator("tbody tr")


def test_lines_come_piece_by_piece_as_one_looks_down(opened):
    assert lines(opened).count() == 200
    opened.locator("#more button").dispatch_event("click")  # a scroll to it would load more, and move it away
    assert lines(opened).count() >= 400
    assert opened.complaints == []


def test_what_is_searched_for_is_shown_and_the_worst_is_first(opened):
    opened.locator("#filter input").fill("airframe_3/")
    assert lines(opened).count() == 27
    assert "27 of 1001 logs" in opened.inner_text("#shown")
    opened.locator("#filter input").fill("")
    assert lines(opened).first.locator("td").all_inner_texts()[:2] == [HOSTILE, "failed"]
    assert lines(opened).first.locator("a").get_attribute("href") == "pages/hostile.html"
    assert opened.complaints == []
