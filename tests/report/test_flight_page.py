"""The page of a log: verdict first, every spike, no place, without mouse or network."""

import re
from functools import cache

import numpy as np
import pandas as pd
import pytest
from markupsafe import escape

import gtmbench as gb
from gtmbench.report.page.flight import flight_page, panel
from gtmbench.report.words.units import round_values
from gtmbench.report.words.verdict import verdict_text
from tests.helpers.browsers import Seen, clipped, looking_at
from tests.helpers.night import by_day

HOSTILE = "<script>alert('x')<|script>`**\u202e]( {{ 7*7 }} $x$ <|title>.csv"
COMMAND = "gtmbench monitor flight.csv --healthy 0:50"


@cache
def record_with(bias, seconds=110.0):
    flight = gb.fly(excitation="multisine+turbulence", duration_s=seconds, seed=3)
    record = gb.decimate(gb.measure(flight, noise="t2", seed=3), 4).select(["p", "q", "r", "phi", "theta", "psi"])
    return gb.inject(record, gb.Bias(channel="q", onset_s=80.0, size=bias)) if bias else record


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flights") / "somebody's place"
    folder.mkdir()
    gb.write_log(record_with(4.0), folder / "flight.csv")
    return folder


@pytest.fixture(scope="module")
def watched(folder):
    return gb.watch_log(folder / "flight.csv", "auto", healthy=[(0.0, 50.0)])


@pytest.fixture(scope="module")
def page(watched):
    return flight_page(watched, COMMAND)


# ---- what it says ----


@pytest.mark.nightly
def test_the_verdict_is_the_title_and_every_part_is_there(watched, page):
    text = Seen(page).text
    verdict = verdict_text(watched)
    assert verdict.startswith("The pitch gyro (q) failed from ")
    assert f'<h1 class="failed">{escape(verdict)}</h1>' in page
    order = ["sensor", "Why", "How sure", "Learnt from", "The state of each sensor", "Pitch gyro (q)"]
    order += ["Alarms", "From which size on", COMMAND, "SHA-256"]
    places = [text.index(part) for part in order]
    assert places == sorted(places)


@pytest.mark.nightly
def test_lines_keep_every_sample_about_a_fault_to_what_can_be_seen(watched, page):
    record = watched.log.segments[0]
    (path,) = re.findall(
        r'data-name="measured" d="([^"]*)"', page.partition("Pitch gyro (q)")[2].partition("</figure>")[0]
    )
    points = np.array([point.split(",") for stroke in path.split("M")[1:] for point in stroke.split()], dtype=float)
    shown = (points[:, 0] > 79.0) & (points[:, 0] < 82.0)
    own = (record.time_s - record.start_s > 79.0) & (record.time_s - record.start_s < 82.0)
    assert np.count_nonzero(shown) == np.count_nonzero(own)
    assert np.abs(points[shown, 1] - record["q"][own]).max() < 1e-3 * np.ptp(record["q"])


@pytest.mark.parametrize("seconds", [60.0, 3600.0])
def test_a_spike_of_one_sample_is_seen_and_an_hour_stays_small(seconds):
    time_s = np.arange(round(100 * seconds)) / 100.0
    values = np.sin(time_s)
    values[len(values) // 3] = 50.0
    values[1000:2000] = np.nan
    made = panel(
        "q", "deg/s", [("measured", "measured", [(time_s, values)])], span=(0.0, seconds), close=[(20.0, 40.0)]
    )
    (line,) = made.lines
    assert made.high > 50.0
    assert ",50" in line["path"]
    assert line["path"].count("M") == 2
    assert len(line["path"]) < 120_000  # 13 of them in a page of 2 MB


@pytest.mark.parametrize("span", [(0.0, 1e-3), (-3.0, 4.0), (1.7e9, 1.7e9 + 90.0), (-1e6, 5e7)])
def test_round_values_lie_within_and_are_evenly_apart(span):
    values = round_values(span)
    assert 3 <= len(values) <= 9
    assert span[0] - 1e-9 <= values[0] < values[-1] <= span[1] + 1e-9 * abs(span[1])
    assert np.ptp(np.diff(values)) < 1e-6 * (span[1] - span[0])


# ---- what it must not do ----


@pytest.mark.nightly
def test_it_tells_no_place_and_asks_nothing_of_a_network(folder, page):
    assert str(folder) not in page
    assert "somebody" not in page
    assert all(reference.startswith("#") for reference in Seen(page).references)
    assert "http" not in page.replace("http-equiv", "")
    assert "url(" not in page
    assert "default-src 'none'" in page


@pytest.mark.nightly
def test_hostile_names_stay_words(folder):
    gb.write_log(record_with(0.0, 70.0), folder / HOSTILE)
    page = flight_page(gb.watch_log(folder / HOSTILE, "auto", healthy=[(0.0, 50.0)]), f"gtmbench monitor {HOSTILE}")
    seen = Seen(page)
    assert (seen.tags.count("script"), seen.tags.count("h1")) == (1, 1)
    assert HOSTILE in seen.text


# ---- the command ----


@pytest.mark.nightly
def test_a_fleets_report_links_to_the_pages_of_what_failed(cli, tmp_path):
    for name, bias in (("broken.csv", 4.0), ("well.csv", 0.0)):
        gb.write_log(record_with(bias, 110.0), tmp_path / name)
    assert cli("monitor", "broken.csv", "well.csv", "--healthy", "0:50", "--out", "fleet", "-q")[0] == 1
    report = (tmp_path / "fleet/fleet.html").read_text()
    (link,) = re.findall(r'href="(pages/[^"]*)"', report)
    assert link.startswith("pages/broken.csv-")
    assert "The pitch gyro (q) failed" in (tmp_path / "fleet" / link).read_text()


# ---- in a browser ----


@pytest.fixture(scope="module")
def opened(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "flight.html"
    path.write_text(page)
    with looking_at(path) as look:
        yield look


def window(tab):
    return [float(part) for part in tab.locator(".panel svg").nth(2).get_attribute("viewBox").split()]


@pytest.mark.nightly
@pytest.mark.browser
@pytest.mark.parametrize(("width", "scheme"), [(375, "light"), (1280, "dark")])
def test_a_browser_shows_it_without_complaint_and_without_scrolling_sideways(opened, width, scheme):
    tab = opened(width, color_scheme=scheme)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.complaints == []
    assert all(url.startswith("file:") for url in tab.requests)


@pytest.mark.browser
@pytest.mark.parametrize(("width", "printed"), by_day([(375, False), (1280, False), (1280, True)], 0))
def test_no_word_is_cut_off_on_a_phone_or_on_paper(opened, width, printed):
    assert clipped(opened(width), printed=printed) == []


@pytest.mark.nightly
@pytest.mark.browser
def test_beyond_an_hour_times_are_hours_with_the_log_s_stamps_beside(opened, folder, tmp_path):
    table = pd.read_csv(folder / "flight.csv")
    began = pd.Timestamp("2026-05-04 22:30:00.020")
    far_s = table["time_s"] + np.where(np.arange(len(table)) > 500, 3600.0, 0.0)  # a gap of an hour
    table["time_s"] = [(began + pd.Timedelta(seconds=time_s)).isoformat(" ", "milliseconds") for time_s in far_s]
    table.to_csv(tmp_path / "late.csv", index=False)
    (tmp_path / "late.html").write_text(flight_page(gb.watch_log(tmp_path / "late.csv", "auto"), COMMAND))
    assert clipped(opened(375, at=tmp_path / "late.html"), printed=True) == []
    tab = opened(375, at=tmp_path / "late.html")
    assert tab.locator(".x span").last.inner_text() == "1:00:00"
    assert clipped(tab) == []
    tab.get_by_role("button", name=re.compile("^Fault at")).first.click()
    assert all(re.fullmatch(r"1:\d\d:\d\d", name) for name in tab.locator(".x span").all_inner_texts())
    pitch = tab.locator("figure.panel", has_text="Pitch gyro (q)")
    pitch.locator("svg").focus()  # which scrolls: a mouse that rests over another panel would read there
    tab.mouse.move(1, 1)
    tab.keyboard.press("ArrowRight")
    said = re.match(r"(\d+\.\d\d) s \((\d\d:\d\d:\d\d\.\d)\)", pitch.locator("output").inner_text())
    stamped = pd.Timestamp(f"2026-05-04 {said[2]}")
    zero = began + pd.Timedelta(seconds=far_s[0])  # times are since the first stamp
    assert abs((stamped - zero).total_seconds() - float(said[1])) < 0.11
    assert tab.complaints == []


@pytest.mark.nightly
@pytest.mark.browser
def test_buttons_keys_and_the_mouse_zoom_and_read(opened, watched):
    tab = opened(1280)
    whole = window(tab)
    tab.get_by_role("button", name=re.compile("^Fault at")).click()
    near = window(tab)
    assert near[0] < 80.0 < near[0] + near[2]
    assert near[2] < 0.5 * whole[2]
    pitch = tab.locator("figure.panel", has_text="Pitch gyro (q)")
    panel = pitch.locator("svg")
    panel.focus()
    for _ in range(3):
        tab.keyboard.press("ArrowRight")
    said = pitch.locator("output").inner_text()
    time_s, value = map(float, re.match(r"([\d.]+) s: measured (-?[\d.]+)", said).groups())
    record = watched.log.segments[0]
    assert abs(record["q"][np.abs(record.time_s - time_s).argmin()] - value) < 0.05 * np.ptp(record["q"])
    tab.keyboard.press("0")
    assert window(tab)[::2] == pytest.approx(whole[::2])
    box = panel.bounding_box()
    tab.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20)
    tab.mouse.up()
    assert window(tab)[2] == pytest.approx(0.25 * whole[2], rel=0.02)
    assert tab.complaints == []


@pytest.mark.nightly
@pytest.mark.browser
def test_it_prints_on_two_sheets(opened):
    printed = opened(1280).pdf(format="A4", margin=dict.fromkeys(("top", "bottom", "left", "right"), "12mm"))
    assert len(re.findall(rb"/Type\s*/Page[^s]", printed)) <= 2
