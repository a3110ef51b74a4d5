"""A page in a browser that reaches no network: what it complains of, and what it asks for."""

import shutil
from contextlib import contextmanager
from html.parser import HTMLParser

import pytest

BROWSERS = ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"]
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)


class Seen(HTMLParser):
    """Tags, what they refer to, and the text of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.references, self.text = [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.references += [value for name, value in attributes if name in ("src", "href", "action", "srcset")]

    def handle_data(self, data):
        self.text += data


@contextmanager
def looking_at(path):
    """Give a function that opens a page, so many pixels wide; skips where there is no browser."""
    if BROWSER is None:
        pytest.skip("the page needs a browser (Debian: chromium-headless-shell)")
    playwright = pytest.importorskip("playwright.sync_api", reason="the page needs playwright")
    with playwright.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])

        def look(width, **how):
            context = browser.new_context(viewport={"width": width, "height": 800}, offline=True, **how)
            tab = context.new_page()
            tab.complaints, tab.requests = [], []
            tab.on("console", lambda message: tab.complaints.append(message.text))
            tab.on("pageerror", lambda error: tab.complaints.append(str(error)))
            tab.on("request", lambda request: tab.requests.append(request.url))
            tab.goto(path.as_uri())
            return tab

        yield look
        browser.close()
