"""Facts of aircraft as files: one `aircraft.toml`, commented to be edited, and the list of many."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.items import Item

Facts = Mapping[str, Any]

_OF_SMALL = {
    "spin_up": "true: its propellers are turned up before a flight, because JSBSim's own search for their speed fails",
    "settle": "true: its engines run until their thrust is steady before a flight, because JSBSim's own search fails",
    "steps_a_sample": "JSBSim's steps in a sample of 0.01 s: small propellers change quicker than that",
    "rudderless": "true: nothing answers the rudder command, and trim finds a sideslip instead",
    "motorless": "true: nothing answers the throttle command, and trim finds a steady descent (its guess: deg)",
}
_SECTIONS = {
    "trim": "where it is trimmed, and where the search for that begins (deg, percent of throttle)",
    "commands": "how commands reach the model: a property, and what 1 of it is in deg (of the throttle: in percent)",
    "limits": "what can be commanded: deg, percent",
    "excitation": "how many times what an excitation moves on the GTM (a multisine: 0.7 deg RMS) it moves here",
    "envelope": "where the model is valid; a flight that leaves it is an error. Any channel may stand here",
    "departure": "beyond this it isn't flown any more but falls; of a flight in the loop that is an event",
    "autopilot": "gains of the autopilot that flies in the loop; found by gtmbench aircraft NAME --autopilot",
    "chain": "by sensor, the way from motion to reading: rate_hz, delay_s, filter_hz, quantum, noise",
    "chain_autopilot": "gains of the autopilot on that chain; gtmbench aircraft NAME --autopilot --sensors chain",
    "properties": "what is set when the model has been loaded: gear, flaps, fuel, levers of engines, other simulators'",
}


def commented(facts: Facts, model: str | None = None) -> str:
    """Return facts as an ``aircraft.toml`` that says what each means.

    >>> print(commented({"title": "A kite", "without_io": False, "trim": {"altitude_ft": 300.0}}, "../kite"))
    # What gtmbench knows of this aircraft beyond its JSBSim model. Every figure is to be edited.
    title = "A kite"
    model = "../kite"  # a name of `gtmbench list --all`, or a folder's path
    without_io = false  # true: leave out input and output sections, which would open ports and write files
    <BLANKLINE>
    # where it is trimmed, and where the search for that begins (deg, percent of throttle)
    [trim]
    altitude_ft = 300.0
    <BLANKLINE>
    """
    lines = [
        "# What gtmbench knows of this aircraft beyond its JSBSim model. Every figure is to be edited.",
        f"title = {_value(facts['title'])}",
        *([f"model = {_value(model)}  # a name of `gtmbench list --all`, or a folder's path"] if model else []),
        f"without_io = {_value(facts['without_io'])}  # true: leave out input and output sections, which would open "
        "ports and write files",
        *(f"{key} = {_value(facts[key])}  # {said}" for key, said in _OF_SMALL.items() if key in facts),
    ]
    for section in _SECTIONS:
        if table := facts.get(section):
            lines += ["", *_section(section, table)]
    return "\n".join(lines) + "\n"


def autopilot_table(gains: Facts, section: str = "autopilot") -> str:
    """Return gains as the table of an ``aircraft.toml`` or a scenario; on a chain, as ``[chain_autopilot]``.

    >>> print(autopilot_table({"psi_to_phi": 0.8}))
    # gains of the autopilot that flies in the loop; found by gtmbench aircraft NAME --autopilot
    [autopilot]
    psi_to_phi = 0.8
    <BLANKLINE>
    """
    return "\n".join(_section(section, gains)) + "\n"


def _section(section: str, table: Facts) -> list[str]:
    values = [f"{tomlkit.key(key).as_string()} = {_value(value)}" for key, value in table.items()]
    return [f"# {_SECTIONS[section]}", f"[{section}]", *values]


def listed(entries: Mapping[str, Facts], head: str) -> str:
    """Return the facts of many aircraft, a table each, each fact in a line; `head` are lines of comment."""
    document = tomlkit.parse(head)
    for name in sorted(entries, key=str.casefold):
        table = tomlkit.table()
        table.update({key: _inline(value) for key, value in entries[name].items()})
        document[name] = table
    return tomlkit.dumps(document)


def _value(value: Any) -> str:
    return _inline(value).as_string()


def _inline(value: Any) -> Item:
    """Return what stands in one line, tables too."""
    if not isinstance(value, Mapping):
        item: Item = tomlkit.item(value)
        return item
    table = tomlkit.inline_table()
    table.update({key: _inline(each) for key, each in value.items()})
    return table
