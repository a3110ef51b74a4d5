"""Writing baselines: a new file, or new figures in an old one, whose settings and comments stay as they are."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Collection, Mapping, MutableMapping, Sequence
from pathlib import Path
from typing import Any

from gtmbench.check.baseline import TOLERATED, is_detectors_file, reference_of
from gtmbench.check.compare import pairs
from gtmbench.check.figures import Group, Value
from gtmbench.check.rules import FORMER, KINDS, RULES
from gtmbench.checks import printable
from gtmbench.errors import InputError
from gtmbench.files import LARGEST_TOML_BYTES, atomic_write
from gtmbench.shipped import shipped_scenarios
from gtmbench.study.scenario import load_scenario

_A_LINE = 10  # numbers of a list
_BARE = re.compile("[A-Za-z0-9_-]+")  # keys that TOML takes without quotes
_REMEDY = "remove what stands from [recorded] on"
_HEAD = """\
# A baseline of `gtmbench check`: what is run, how much worse a figure may get, and the figures of a run that was good.
# Edit what stands above [recorded]; `gtmbench check {name} --update` writes what stands below, and keeps comments.

# names of `gtmbench list`, or files, found from this one's folder
scenarios = [{scenarios}]
# of excitation and noise
seed = {seed}
# a monitor's file of `gtmbench calibrate`, or a detector, calibrated in every run; without: [operator] and [alarm]
{detector}

[tolerances]  # a share of the figure, a number in its unit, or the larger of both; better is never too much
{tolerances}
"""


def new_baseline(path: Path, *, scenarios: Sequence[str], detector: str | None) -> str:
    """Return the text of a baseline without figures.

    Parameters
    ----------
    path : Path
        Where it will stand: its files are named from there.
    scenarios : sequence of str
        Shipped names, or files.
    detector : str, optional
        A name of `gtmbench list`, a bank's or a monitor's file, or the own name of a detector in Python.

    Raises
    ------
    InputError
        Where the first scenario, whose seed it takes, can't be read.
    """
    strange = ("thresholds", "isolation_delay_s") if detector is None else ("threshold",)
    keys = [key for key in TOLERATED if key not in strange]
    stated = [f"{key} = {json.dumps(RULES[key].tolerance)}" for key in keys]
    width = max(len(line) for line in stated)
    return _HEAD.format(
        name=printable(path.name),
        scenarios=", ".join(_text(_seen_from(path, name, shipped_scenarios())) for name in scenarios),
        seed=load_scenario(scenarios[0]).setup.seed,
        detector='# detector = "monitor.json"'
        if detector is None
        else f"detector = {_text(_seen_from(path, detector, () if is_detectors_file(detector) else (detector,)))}",
        tolerances="\n".join(
            f"{line:<{width}}  # {RULES[key].meaning}" for line, key in zip(stated, keys, strict=True)
        ),
    )


def write_figures(path: Path, text: str, *, seed: int, groups: Sequence[Group]) -> None:
    """Put figures into a baseline's text, in the place of those that are there, and write it.

    Raises
    ------
    InputError
        Where it can't be written, or would be too large to be read.
    """
    from tomlkit.exceptions import TOMLKitError

    try:
        written = renewed(text, figures_text(seed, groups))
    except TOMLKitError as error:
        raise InputError(f"{path}: its layout doesn't take the figures ({error}); {_REMEDY}") from error
    size = len(written.encode())
    if size > LARGEST_TOML_BYTES:
        raise InputError(
            f"{path} would have {size} bytes, and a baseline has at most {LARGEST_TOML_BYTES}; take fewer scenarios"
        )
    reread = reference_of(path, tomllib.loads(written))
    if any(repr(pair.was) != repr(pair.now) for pair in pairs(reread.recorded, groups)):
        raise InputError(f"{path}: its layout doesn't take the figures; {_REMEDY}")
    with atomic_write(path) as aside:
        aside.write_text(written, encoding="utf-8")


def renewed(text: str, figures: str) -> str:
    r"""Return a baseline's text with other figures; its settings, its comments and its order stay.

    >>> renewed("[recorded]  # anew\nseed = 2  # mine", "[recorded]\nseed = 3")
    '[recorded]  # anew\nseed = 3  # mine'
    """
    import tomlkit

    document, fresh = tomlkit.parse(in_names_of_now(text)), tomlkit.parse(figures)
    own = ("recorded", *KINDS, *FORMER)
    if not any(name in document for name in own):
        return f"{in_names_of_now(text).rstrip()}\n\n{figures}"
    for name in own:
        if name not in fresh:
            document.pop(name, None)
        elif name in document:
            _renew(document[name], fresh[name])
        else:
            document[name] = fresh[name]
    return tomlkit.dumps(document)


def in_names_of_now(text: str) -> str:
    r"""Return a baseline's text with what has got another name under that: ``monitor``, norms and levels.

    >>> in_names_of_now('monitor = "C"  # ours\n[norm.r]\n[level.p]  # rad\n').splitlines()
    ['detector = "C"  # ours', '[score."E(k)"]', '[score.p]  # rad']
    """
    settings, table, figures = text.partition("\n[")
    settings = re.sub(
        r"^monitor(?= *=)|^# monitor(?= = \")",
        lambda found: found[0].replace("monitor", "detector"),
        settings,
        flags=re.MULTILINE,
    )
    tables = re.sub(r"^\[norm\.[^\]\n]+\]", '[score."E(k)"]', table + figures, flags=re.MULTILINE)
    return settings + re.sub(r"^\[level\.", "[score.", tables, flags=re.MULTILINE)


def _renew(old: MutableMapping[str, Any], new: Mapping[str, Any]) -> None:
    from tomlkit.items import Table

    for key in [key for key in old if key not in new]:
        del old[key]
    for key, value in new.items():
        if key in old and isinstance(value, Table):
            _renew(old[key], value)
        else:
            old[key] = value


def figures_text(seed: int, groups: Sequence[Group]) -> str:
    """Return figures as a baseline has them: a table each, but one line a trial."""
    blocks = [f"[recorded]  # from here on: written by --update\nseed = {seed}\n"]
    blocks += [_block(group) for group in groups if group.kind != "trials"]
    trials = [group for group in groups if group.kind == "trials"]
    return "\n".join([*blocks, "[trials]\n" + "".join(_line(trial) for trial in trials)])


def _block(group: Group) -> str:
    unit = f"  # {group.unit}" if group.unit else ""
    lines = [f"{figure} = {_value(value, group.labels.get(figure, ()))}\n" for figure, value in group.values.items()]
    name = group.name if _BARE.fullmatch(group.name) else _text(group.name)
    return f"[{group.kind}.{name}]{unit}\n" + "".join(lines)


def _line(trial: Group) -> str:
    figures = ", ".join(f"{figure} = {_value(value)}" for figure, value in trial.values.items())
    return f"{_text(trial.name)} = {{ {figures} }}\n"


def _value(value: Value, labels: Sequence[str] = ()) -> str:
    """Return a value as TOML has it; a list with labels in lines, each with the label of its first number."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, tuple):
        return repr(value)
    if not labels:
        return f"[{', '.join(repr(one) for one in value)}]"
    lines, width = [], max((len(repr(one)) for one in value), default=0)
    for i in range(0, len(value), _A_LINE):
        numbers = ", ".join(f"{one!r:>{width}}" for one in value[i : i + _A_LINE])
        lines.append(f"  {numbers},  # {labels[i]}, ...\n")
    return "[\n" + "".join(lines) + "]"


def _text(given: str) -> str:
    return json.dumps(given, ensure_ascii=False).replace(
        "\x7f", "\\u007f"
    )  # the one that TOML escapes and JSON doesn't


def _seen_from(path: Path, name: str, shipped: Collection[str]) -> str:
    """Return a shipped name, or a file's path from the folder of a baseline."""
    return name if name in shipped else Path(os.path.relpath(Path(name), path.absolute().parent)).as_posix()
