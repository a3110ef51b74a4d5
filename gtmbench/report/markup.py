"""Texts and tables as HTML and Markdown: of templates, and of what may hold anything.

A page is one file and asks nothing of any network: style, script and figures stand in it, its security policy allows
nothing else, and whatever a file or a name says is escaped.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Sequence
from hashlib import sha256
from importlib import resources
from typing import TYPE_CHECKING

from gtmbench.report.words.units import padded

if TYPE_CHECKING:
    import pandas as pd


def html_page(
    template: str, script: str, style: str = "", *, said: Callable[[str], str] = str, **values: object
) -> str:
    """Return a page of one of the templates beside this file.

    `said`: what becomes of every text before it is escaped. **values: what the template says.
    """
    from markupsafe import Markup

    code = _beside(script)
    page = text_page(
        template,
        said,
        style=Markup(_beside("page.css") + (_beside(style) if style else "")),  # noqa: S704  our own files
        script=Markup(code),  # noqa: S704
        script_digest=base64.b64encode(sha256(code.encode()).digest()).decode(),
        **values,
    )
    return page.encode(errors="replace").decode()  # names of files may be no Unicode


def text_page(template: str, said: Callable[[str], str] = str, **values: object) -> str:
    """Return a text of one of the templates; in HTML what values say is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    is_html = ".html." in template
    environment = Environment(
        loader=PackageLoader("gtmbench.report", "page"),
        autoescape=is_html,  # noqa: S701  Markdown and YAML are of our own figures
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=not is_html,
        finalize=lambda value: said(value) if type(value) is str else value,
    )
    return environment.get_template(template).render(**values)


def _beside(name: str) -> str:
    return resources.files("gtmbench.report.page").joinpath(name).read_text(encoding="utf-8")


def picture(drawn: bytes, kind: str = "png") -> str:
    """Return an image as the address of one that stands in the page itself."""
    return f"data:image/{kind};base64,{base64.b64encode(drawn).decode()}"


_MARKS = {mark: f"&#{ord(mark)};" for mark in "|`*\\"} | {"&": "&amp;", "<": "&lt;"}  # of Markdown and HTML


def in_markdown(text: str) -> str:
    """Return a text that Markdown shows as it is, in one line."""
    return " ".join("".join(_MARKS.get(letter, letter) for letter in text).replace("](", "]&#40;").split())


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table whose cells may hold anything."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(map(in_markdown, line))} |" for line in lines)


def markdown(frame: pd.DataFrame) -> str:
    """Return a frame as a Markdown table, its columns aligned so that a terminal shows it, too."""
    head = [str(name) for name in frame.columns]
    rows = [[str(value) for value in row] for row in frame.to_numpy(dtype=object)]
    head, *rows = padded([head, *rows])
    lines = [head, ["-" * len(cell) for cell in head], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
