"""How values show themselves in a notebook: a heading, a few facts, a table. Everything is escaped."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Template

_MOST_ROWS = 40  # of a card: a screen
_CARD = """\
<div class="gtmbench">
<style>.gtmbench :is(th, td) {padding: 0.1em 0.8em; text-align: left}</style>
<p><strong>{{ title }}</strong>{% for name, value in facts.items() %}<br>{{ name }}: {{ value }}{% endfor %}</p>
{% if rows %}
<table>
<thead><tr>{% for column in columns %}<th scope="col">{{ column }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</tbody>
</table>
{% endif %}
{% if more %}
<p>and {{ more }} more</p>
{% endif %}
</div>"""


@cache
def _template() -> Template:
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(_CARD)


def card(
    title: str,
    facts: Mapping[str, object] | None = None,
    *,
    columns: Sequence[str] = (),
    rows: Sequence[Sequence[object]] = (),
) -> str:
    """Return a value as a piece of HTML, for its ``_repr_html_``; of a long table the first rows.

    >>> print(card("Record", {"length": "20 s"}, columns=["channel"], rows=[["<p>"]]))
    <div class="gtmbench">
    <style>.gtmbench :is(th, td) {padding: 0.1em 0.8em; text-align: left}</style>
    <p><strong>Record</strong><br>length: 20 s</p>
    <table>
    <thead><tr><th scope="col">channel</th></tr></thead>
    <tbody>
    <tr><td>&lt;p&gt;</td></tr>
    </tbody>
    </table>
    </div>
    """
    more = max(len(rows) - _MOST_ROWS, 0)
    return _template().render(title=title, facts=facts or {}, columns=columns, rows=rows[:_MOST_ROWS], more=more)


def figure(value: float | None, form: str = ".4g") -> str:
    """Write a number for a card; a dash where there is none.

    >>> figure(0.123456), figure(None), figure(float("nan")), figure(12.0, ".2f")
    ('0.1235', '-', '-', '12.00')
    """
    return "-" if value is None or not math.isfinite(value) else f"{value:{form}}"
