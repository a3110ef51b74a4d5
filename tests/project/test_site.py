"""The documentation as built by `make docs`: every link leads somewhere, and a browser without a network shows it."""

from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from gtmbench.api import __all__ as public
from tests.helpers.browsers import BROWSER
from tests.helpers.commands import COMMANDS
from tests.helpers.night import by_day

SITE = Path(__file__).parents[2] / "out/docs"
PAGES = [page for page in sorted(SITE.rglob("*.html")) if "_static" not in page.parts]

pytestmark = pytest.mark.skipif(not PAGES, reason="the documentation isn't built: make docs")


class _Found(HTMLParser):
    """The links and anchors of a page."""

    def __init__(self):
        super().__init__()
        self.links, self.anchors = [], set()

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.links += [given[key] for key in ("href", "src") if given.get(key)]
        self.anchors |= {given.get("id"), given.get("name")}


@cache
def found(page):
    parser = _Found()
    parser.feed(page.read_text())
    return parser


@pytest.mark.nightly
def test_every_link_leads_to_a_page_and_a_place_on_it():
    lost = []
    for page in PAGES:
        for link in found(page).links:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            there = target.is_file()
            if there and target.suffix == ".html" and parts.fragment and target in PAGES:
                there = unquote(parts.fragment) in found(target).anchors
            if not there:
                lost.append((page.relative_to(SITE).as_posix(), link))
    assert lost == []


def test_every_public_name_and_every_command_has_a_place():
    names = (SITE / "reference/generated/names.html").read_text()
    assert [name for name in public if f"gtmbench.{name}.html" not in names] == []
    assert {f"gtmbench-{name}" for name in COMMANDS} <= found(SITE / "reference/cli.html").anchors


def test_formulas_are_drawn_by_the_browser_itself():
    page = SITE / "explanation/method.html"
    assert page.read_text().count("<math") > 10
    assert not any("mathjax" in link.lower() for link in found(page).links)


@pytest.fixture(scope="module")
def opened():
    """Open pages in a browser that reaches no network, on a screen and on a phone."""
    if BROWSER is None:
        pytest.skip("the site needs a browser (Debian: chromium-headless-shell)")
    playwright = pytest.importorskip("playwright.sync_api", reason="the site needs playwright")
    with playwright.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])

        def look(name, width):
            tab = browser.new_context(viewport={"width": width, "height": 800}, offline=True).new_page()
            tab.errors, tab.requests = [], []
            tab.on("pageerror", lambda error: tab.errors.append(str(error)))
            tab.on("request", lambda request: tab.requests.append(request.url))
            tab.goto(f"{SITE.as_uri()}/{name}")
            return tab

        yield look
        browser.close()


LOOKED_AT = (
    "index",
    "tutorial/first_flight",
    "how_to/my_log",
    "explanation/method",
    "reference/scenario_keys",
    "reference/generated/channels",
    "reference/generated/gtmbench.Record",
)


@pytest.mark.browser
@pytest.mark.parametrize("width", by_day([390, 1280]))
def test_pages_show_without_a_network_and_without_scrolling_sideways(opened, width):
    for name in LOOKED_AT:
        tab = opened(f"{name}.html", width)
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, name
        assert tab.errors == [], name
        assert all(url.startswith(("file:", "data:")) for url in tab.requests), name
        assert tab.evaluate("[...document.images].every((image) => image.complete && image.naturalWidth > 100)"), name
        tab.context.close()
    tab = opened("explanation/method.html", width)
    assert tab.evaluate("document.querySelectorAll('.bd-article img').length") >= 2
    assert tab.evaluate("document.querySelector('.formula math').getBoundingClientRect().height") > 20


@pytest.mark.browser
def test_the_search_finds_the_page_on_deadzones(opened):
    tab = opened("search.html?q=deadzone", 1280)
    tab.wait_for_selector("#search-results li a")
    results = tab.locator("#search-results li a").all_inner_texts()
    assert any("Deadzone" in text for text in results)
    tab.locator("#search-results li a").first.click()
    assert "deadzone" in tab.inner_text("article").lower()
