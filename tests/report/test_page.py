"""The report of a campaign: one page that asks nothing of a network, escapes everything, and is read on a phone."""

import base64
import json
import re
from pathlib import Path

import pytest

from gtmbench.jobs.parts import parts_in, read_parts
from gtmbench.report.markup import in_markdown
from gtmbench.report.page.campaign import contents_of, data, markdown, page
from gtmbench.report.tables.scores import confusions
from gtmbench.study.campaign.conduct import WHAT
from gtmbench.study.campaign.plan import load_campaign
from gtmbench.study.campaign.rows import table_of
from tests.helpers.browsers import Seen, clipped, looking_at
from tests.helpers.hostile import refused
from tests.helpers.night import by_day
from tests.study.campaign.test_scores import healthy, search, trial

HOSTILE = "<script>alert('x')</script>|`**\u202e]( {{ 7*7 }} $x$ </title>"
NAMES = {"isolated": True, "named_wrong": False, "axis_right": True, "sensor": "p", "kind": "jam", "kind_right": True}


def rows_of_flight(flight, detectors=("quick", "slow", "siren")):
    rows = []
    for place, name in enumerate(detectors):
        rows += [
            healthy(name, flight, false_alarms=9 * (name == "siren"), peak_ratio=0.3 + 0.05 * flight),
            trial(name, flight, 0.1 + 0.01 * flight + 2.0 * place, **NAMES),
            trial(name, flight, None, channel="q", **NAMES | {"isolated": False, "sensor": None}),
            {**search(flight, 0.1 * (1 + place)), "detector": name},
        ]
    return rows


def campaign_in(folder, title="Three of them", detectors=("quick", "slow", "siren"), flights=8, of=None):
    """Leave the folder of a campaign that was never flown."""
    facts = {**load_campaign("ci").facts(), "name": "never flown", "title": title, "detectors": list(detectors)}
    with parts_in(
        folder, what=WHAT, tasks=of or flights, facts={"campaign": facts, "versions": {"gtmbench": "0"}}
    ) as parts:
        for flight in range(flights):
            parts.write(flight, table_of(rows_of_flight(flight, detectors)))
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return campaign_in(tmp_path_factory.mktemp("campaign") / "out")


@pytest.fixture(scope="module")
def contents(folder):
    return contents_of(read_parts(folder))


# ---- what it says ----


def test_the_verdict_comes_first_and_names_who_gets_no_score(contents):
    first, *others = contents.verdict
    assert first == "quick is the first of 2 detectors, significantly sooner than every other."
    assert any(line.startswith("siren gets no score: more than 7") for line in others)
    text = Seen(page(contents)).text
    assert text.index(first) < text.index("What was run") < text.index("gtmbench campaign")


def test_a_campaign_without_its_end_says_so(tmp_path):
    contents = contents_of(read_parts(campaign_in(tmp_path / "out", flights=2, of=5)))
    assert "Not finished: 3 of 5 flights are still to be flown (--resume)." in contents.verdict


def test_json_has_null_for_what_has_no_score_and_the_reason(contents):
    found = json.loads(data(contents))
    siren = next(one for one in found["detectors"] if one["name"] == "siren")
    assert siren["merits"] is None
    assert "target" in siren["no_score"]
    quick = next(one for one in found["detectors"] if one["name"] == "quick")
    assert quick["merits"]["detected"]["hits"] == 8
    assert quick["smallest"][0]["severity"]["value"] == 0.1
    assert found["facts"]["versions"] == {"gtmbench": "0"}
    assert found["ranks"][0] == {"detector": "quick", "best": 1, "worst": 1}


def test_the_same_parts_are_the_same_page(contents, folder):
    assert page(contents) == page(contents_of(read_parts(folder)))


def test_markdown_has_every_table_and_no_broken_row(contents):
    text = markdown(contents)
    assert all(f"## {table.title}" in text for table in contents.tables)
    tables = [block.splitlines() for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE)]
    assert len(tables) == len(contents.tables) + len(confusions(contents.scores))
    assert all(len({line.count("|") for line in lines}) == 1 for lines in tables)


# ---- what it must not do ----


def test_the_page_refers_to_nothing_outside_of_itself(contents):
    text = page(contents)
    seen = Seen(text)
    assert seen.references
    assert all(reference.startswith(("#", "data:image/svg+xml;base64,")) for reference in seen.references)
    assert "http" not in re.sub(r'http-equiv="|data:image[^"]*', "", text)
    assert "@import" not in text
    assert "url(" not in text


@pytest.mark.parametrize("where", by_day(["title", "detector"]))
def test_hostile_words_stay_words(tmp_path, where):
    names = (HOSTILE, "slow") if where == "detector" else ("quick", "slow")
    title = HOSTILE if where == "title" else "Three"
    contents = contents_of(read_parts(campaign_in(tmp_path / "out", title=title, detectors=names)))
    seen = Seen(page(contents))
    assert seen.tags.count("script") == seen.tags.count("title") == 1
    assert HOSTILE in seen.text
    for reference in seen.references:
        if reference.startswith("data:"):
            assert b"<script" not in base64.b64decode(reference.partition(",")[2])
    text = markdown(contents)
    assert "<script" not in text
    assert "](" not in text
    assert json.loads(data(contents))["detectors"][0]["name"] == names[0]


def test_markdown_shows_names_as_they_are():
    assert in_markdown("a|b\n*c* [d](e) & <f>") == "a&#124;b &#42;c&#42; [d]&#40;e) &amp; &lt;f>"


# ---- the command ----


def test_the_command_writes_what_it_is_asked_for(cli, folder, tmp_path):
    assert cli("campaign", folder, "--report", "html")[0] == 0
    assert (folder / "report.html").read_text().startswith("<!doctype html>")
    (tmp_path / "there").mkdir()
    for arguments, path in [
        (["md", "--out", "x.md"], "x.md"),
        (["json", "--out", "there"], "there/report.json"),
        (["table", "--out", "there"], "there/table.md"),
    ]:
        code, out, _ = cli("campaign", folder, "--report", *arguments, "--json")
        found = json.loads(out)
        assert (code, found["out"]) == (0, path)
        assert found["verdict"].startswith("quick is the first")
        assert (tmp_path / path).is_file()
    assert "--force" in refused(cli("campaign", folder, "--report", "md", "--out", "x.md"))
    assert cli("campaign", folder, "--report", "md", "--out", "x.md", "--force")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--out", "report.pdf"], "--report html is a .html"),
        (["--deadline", "0"], "--deadline is 0"),
        (["--false-alarms-per-hour", "-1"], "--false-alarms-per-hour is -1"),
    ],
)
def test_what_cant_be_meant_is_one_line(cli, folder, arguments, said):
    assert said in refused(cli("campaign", folder, "--report", "html", *arguments))


def test_folders_that_hold_no_campaign_are_one_line(cli, tmp_path):
    with parts_in(tmp_path / "other", what="fleet", tasks=1, facts={}):
        pass
    campaign_in(tmp_path / "empty", flights=0, of=3)
    for folder, said in [
        (".", "holds no parts"),
        ("other", "no campaign's"),
        ("empty", "nothing of empty is finished"),
    ]:
        assert said in refused(cli("campaign", folder, "--report", "html"))


# ---- in a browser ----


@pytest.fixture(scope="module")
def opened(contents, tmp_path_factory):
    """Open the page in a browser that reaches no network, on a screen and on a phone."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page(contents))
    with looking_at(path) as look:
        yield look


@pytest.mark.browser
@pytest.mark.parametrize("width", [375, 1280])
def test_a_browser_shows_the_page_without_complaint_and_without_scrolling_sideways(opened, width):
    tab = opened(width)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.complaints == []
    assert all(url.startswith(("file:", "data:")) for url in tab.requests)
    assert tab.evaluate("[...document.images].every((image) => image.complete && image.naturalWidth > 100)")
    assert tab.evaluate("document.images.length") >= 2
    assert "is the first" in tab.locator(".verdict").inner_text()


@pytest.mark.browser
@pytest.mark.parametrize(("width", "printed"), by_day([(375, False), (1280, True)]))
def test_no_word_is_cut_off_on_a_phone_or_on_paper(opened, width, printed):
    assert clipped(opened(width), printed=printed) == []


@pytest.mark.nightly
@pytest.mark.browser
def test_code_and_tables_of_the_site_are_whole_on_paper(opened, tmp_path):
    style = (Path(__file__).parents[2] / "docs" / "_static" / "site.css").read_text()
    table = "<table><tr>" + 12 * "<td>a_rather_long_name</td>" + "</tr></table>"
    page = tmp_path / "site.html"
    wide = f"<pre>{40 * 'gtmbench '}</pre><div class='pst-scrollable-table-container'>{table}</div>"
    theme = "pre, .pst-scrollable-table-container { overflow: auto }"
    page.write_text(f"<style>{theme} {style}</style><body><div class='bd-article'>{wide}</div>")
    assert clipped(opened(1280, at=page), printed=True) == []


@pytest.mark.nightly
@pytest.mark.browser
def test_a_click_on_a_heading_sorts_by_figures_and_another_turns_them_round(opened, contents):
    tab = opened(1280)
    column = contents.tables[0].columns.index("median (s)") + 1

    def names():
        return tab.locator("#t1 tbody tr td:nth-child(2)").all_inner_texts()

    assert names() == ["quick", "slow", "siren"]
    tab.locator(f"#t1 th:nth-child({column}) button").click()
    assert names() == ["quick", "slow", "siren"]  # what has no figure stays last
    tab.locator(f"#t1 th:nth-child({column}) button").click()
    assert names() == ["slow", "quick", "siren"]
    assert tab.locator(f"#t1 th:nth-child({column})").get_attribute("aria-sort") == "descending"
