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


_CLIPPED = """(scrolling) => [...document.querySelectorAll('body *')].flatMap((element) => {
  const style = getComputedStyle(element);
  const words = [...element.childNodes].filter((node) => node.nodeType === 3 && node.textContent.trim());
  if (!words.length || style.visibility === 'hidden' || style.display === 'none') return [];
  const range = document.createRange();
  range.selectNodeContents(element);
  const cut = [...range.getClientRects()].some((box) => {
    if (box.width < 1 || box.height < 1) return false;
    if (box.left < -1 || box.right > document.documentElement.clientWidth + 1) {
      for (let around = element; around; around = around.parentElement)
        if (scrolling && ['auto', 'scroll'].includes(getComputedStyle(around).overflowX)) return false;
      return true;
    }
    for (let around = element; around && around !== document.body; around = around.parentElement) {
      const how = getComputedStyle(around).overflowX, edge = around.getBoundingClientRect();
      if (scrolling && ['auto', 'scroll'].includes(how)) return false;
      if (how !== 'visible' && (box.right > edge.right + 1 || box.left < edge.left - 1)) return true;
    }
    return false;
  });
  return cut ? [element.textContent.trim().slice(0, 60)] : [];
})"""


def clipped(tab, *, printed=False):
    """Return the words of a page that somebody can't read whole: cut off, and not to be scrolled to.

    On paper, A4 with margins of 12 mm, nothing scrolls.
    """
    if printed:
        tab.emulate_media(media="print")
        tab.set_viewport_size({"width": 703, "height": 1000})
    return tab.evaluate(_CLIPPED, not printed)


@contextmanager
def looking_at(path):
    """Give a function that opens a page, or another one, so many pixels wide; skips where there is no browser."""
    if BROWSER is None:
        pytest.skip("the page needs a browser (Debian: chromium-headless-shell)")
    playwright = pytest.importorskip("playwright.sync_api", reason="the page needs playwright")
    with playwright.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])

        def look(width, at=path, **how):
            context = browser.new_context(viewport={"width": width, "height": 800}, offline=True, **how)
            tab = context.new_page()
            tab.complaints, tab.requests = [], []
            tab.on("console", lambda message: tab.complaints.append(message.text))
            tab.on("pageerror", lambda error: tab.complaints.append(str(error)))
            tab.on("request", lambda request: tab.requests.append(request.url))
            tab.goto(at.as_uri())
            return tab

        yield look
        browser.close()
