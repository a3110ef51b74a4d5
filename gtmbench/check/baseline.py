"""Baselines of ``gtmbench check``: which scenarios, how much worse is still well, and the figures of a good run.

They are read with every key checked, and written by ``--update``: a new file, or new figures in an old one, whose
settings and comments stay as they are. Figures that aren't those that were recorded are refused, by their digest;
settings are yours to edit, and that they were is said.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
import warnings
from collections.abc import Collection, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gtmbench.check.compare import Recorded, pairs
from gtmbench.check.figures import (
    KINDS,
    OF_LOGS,
    RULES,
    FigureGroup,
    Tolerance,
    Value,
    history_path,
    log_paths,
    new_logs,
    parse_tolerance,
    texts_of,
    trial_names,
)
from gtmbench.checks import boolean, keys, meant, naming, number, printable, shown, table_of, text, whole
from gtmbench.errors import InputError, NoteWarning
from gtmbench.files.seals import KEY, altered, digest_of
from gtmbench.files.shipped import shipped_baselines, shipped_scenarios
from gtmbench.files.writing import LARGEST_TOML_BYTES, is_file, read_toml, write_text
from gtmbench.study.flights import common_setup
from gtmbench.study.scenario import Scenario, load_scenario

_SETTINGS = ("scenarios", "seed", "detector", "tolerances", "logs", "map", "history", "aircraft-id")
_SETTINGS_KEY = "settings"  # in [recorded]: the digest of these
_IN_LINES = ("trials", "sensors")  # tables with a line a group
_A_LINE = 10  # numbers of a list
_BARE = re.compile("[A-Za-z0-9_-]+")  # keys that TOML takes without quotes
_REMEDY = "remove what stands from [recorded] on"


@dataclass(frozen=True, kw_only=True)
class Reference:
    """A baseline: a file that says what is run, and what its figures were."""

    path: Path
    scenarios: tuple[Scenario, ...]
    logs: Mapping[str, Path]  # recorded flights, by their names from the file's folder
    mapping: tuple[str, ...]  # how their columns are read, as ``--map`` takes it
    history: Path | None  # what their airframe's constants are held against
    aircraft_id: str  # whose flights they are; "" for what they say themselves
    seed: int  # of excitation and noise: the file's, else the scenarios'
    # a name of `gtmbench list`, a bank's or a monitor's file; None: the scenarios' own operator and threshold watch
    detector: str | None
    tolerances: Mapping[str, Tolerance]  # by figure
    recorded_seed: int | None = None  # with which the figures were recorded; None where there are none yet
    recorded: Recorded = field(default_factory=dict, repr=False)  # the figures by kind, name and figure
    altered: bool = False  # whether these aren't those that were recorded, by their digest
    # what else should be known before they are held against others: settings were edited, there is no digest
    note: str = ""

    @property
    def trials(self) -> list[str]:
        """The names of the trials that its scenarios make."""
        return trial_names(
            (scenario.name, spec.kind, spec.channel) for scenario in self.scenarios for spec in scenario.faults
        )

    def check_recorded(self) -> None:
        """Refuse figures that are none of what would be run: before the run, not after it."""
        if self.recorded_seed is None:
            raise InputError(f"{self.path}: it holds no figures yet; --update records them")
        if self.recorded_seed != self.seed:
            raise InputError(
                f"{self.path}: its figures are those of seed {self.recorded_seed}, and the seed is {self.seed}; set it "
                "back, or record anew by --update"
            )
        was = self.recorded.get("trials", {})
        new, gone = [name for name in self.trials if name not in was], [name for name in was if name not in self.trials]
        self._check_known("trial", new, gone)
        self._check_known("log", *new_logs(self.recorded.get("sensors", {}), [*self.logs]))
        if self.altered:
            with naming(self.path):
                raise altered("put its copy back, or record anew by --update")
        if self.note:
            warnings.warn(NoteWarning(f"{self.path} {self.note}"), stacklevel=2)

    def _check_known(self, what: str, new: Sequence[str], gone: Sequence[str]) -> None:
        if new:
            raise InputError(f"{self.path}: it holds no figures of {what} '{new[0]}' yet; --update records them")
        if gone:
            raise InputError(
                f"{self.path}: it holds figures of {what} '{gone[0]}', which isn't there any more; put it back, or "
                "drop it by --update"
            )


def find_baseline(source: str) -> Path:
    """Return the path of a baseline: one of the package's by name, else a file that may not exist yet."""
    return shipped_baselines().get(source, Path(source))


def read_reference(path: Path) -> Reference:
    """Read a baseline from a file, every key checked."""
    if not is_file(path):
        known = shipped_baselines()
        raise InputError(
            f"no baseline '{str(path)[:200]}'; give one of {', '.join(known)}, or record one: gtmbench check FILE.toml "
            f"--update{meant(path, known)}"
        )
    return reference_of(path, read_toml(path, "baseline"))


def reference_of(path: Path, table: dict[str, Any]) -> Reference:
    """Return the baseline of a parsed file, every key checked; `path`: where the file stands, or will."""
    with naming(path):
        table = keys(table, (*_SETTINGS, "recorded", *KINDS))
        logs = log_paths(path, texts_of("logs", table["logs"])) if "logs" in table else {}
        scenarios = () if logs and "scenarios" not in table else _scenarios(path, table.get("scenarios"))
        seed = whole("seed", table["seed"]) if "seed" in table else None
        detector = _detector(path, table.get("detector"))
        stated = _known_keys("tolerances", table.get("tolerances", {}), TOLERATED)
        recorded = _known_keys("recorded", table.get("recorded", {}), ("seed", KEY, _SETTINGS_KEY))
        return Reference(
            path=path,
            scenarios=scenarios,
            logs=logs,
            mapping=texts_of("map", table.get("map", [])),
            history=history_path(path, table.get("history")),
            aircraft_id=text("aircraft-id", table["aircraft-id"]) if "aircraft-id" in table else "",
            seed=common_setup(scenarios[:1], seed).seed if scenarios else seed or 0,  # others': when they are run
            detector=detector,
            tolerances={
                name: parse_tolerance(f"tolerances.{name}", stated.get(name, RULES[name].tolerance))
                for name in TOLERATED
            },
            recorded_seed=whole("recorded.seed", recorded["seed"]) if "seed" in recorded else None,
            recorded={kind: _groups(kind, table[kind]) for kind in KINDS if kind in table},
            altered=KEY in recorded and recorded[KEY] != _figures_digest(table),
            note=_note(table, recorded),
        )


def _note(table: Mapping[str, Any], recorded: Mapping[str, Any]) -> str:
    if KEY not in recorded:
        return "carries no digest, so whether its figures were altered can't be told; --update records them"
    if recorded.get(_SETTINGS_KEY) != _settings_digest(table):
        return "has other settings than when it was recorded; if that is meant, --update says so"
    return ""


def _figures_digest(table: Mapping[str, Any]) -> str:
    return digest_of([table["recorded"].get("seed"), {kind: table[kind] for kind in KINDS if kind in table}])


def _settings_digest(table: Mapping[str, Any]) -> str:
    return digest_of({key: table[key] for key in _SETTINGS if key in table})


def _scenarios(path: Path, given: Any) -> tuple[Scenario, ...]:
    if given is None:
        raise InputError("no scenarios given; name those to run")
    if not isinstance(given, list) or not given or not all(isinstance(name, str) for name in given):
        raise InputError(f"scenarios is {shown(given)}; it must be a list of names or files")
    return tuple(load_scenario(name if name in shipped_scenarios() else path.parent / name) for name in given)


def _detector(path: Path, given: Any) -> str | None:
    """Return what watches as it is found from here: a file's path, or a name; a baseline imports no Python."""
    if given is None:
        return None
    if not isinstance(given, str):
        raise InputError(f"detector is {shown(given)}; it must be a name of `gtmbench list`, or a file")
    if is_file_of_detector(given):
        return str(path.parent / given)
    if ":" in given:
        raise InputError(
            f"detector is {shown(given)}, and a baseline imports no Python; state the detector's own name, and give "
            f"--detector {given} on the command line"
        )
    return given


def _groups(kind: str, given: Any) -> dict[str, dict[str, Value]]:
    groups = {}
    for name, figures in table_of(kind, given).items():
        where = f"{kind}.{name}"
        own = _known_keys(where, figures, KINDS[kind][1])
        groups[name] = {key: _value_of(f"{where}.{key}", RULES[key].form, value) for key, value in own.items()}
    return groups


def _value_of(where: str, form: str, given: Any) -> Value:
    if form == "flag":
        return boolean(where, given)
    if form == "count":
        return whole(where, given)
    if form == "list":
        if not isinstance(given, list):
            raise InputError(f"{where} is {shown(given)}; it must be a list of numbers")
        return tuple(_real(f"{where}[{i}]", entry) for i, entry in enumerate(given))
    return _real(where, given)


def _real(where: str, given: Any) -> float:
    """Return a number; nan (there is none) and inf (a threshold that nothing passes) are figures, too."""
    return given if isinstance(given, float) else number(where, given)


def _known_keys(section: str, given: Any, legal: tuple[str, ...]) -> dict[str, Any]:
    return keys(table_of(section, given), legal, section=section)


def write_figures(path: Path, text: str, *, seed: int, groups: Sequence[FigureGroup]) -> None:
    """Put figures into a baseline's text, in the place of those that are there, and write it."""
    from tomlkit.exceptions import TOMLKitError

    try:
        settings = _settings_digest(tomllib.loads(text))
        written = renewed(text, figures_text(seed, groups, settings))
    except TOMLKitError as error:
        raise InputError(f"{path}: its layout doesn't take the figures ({error}); {_REMEDY}") from error
    size = len(written.encode())
    if size > LARGEST_TOML_BYTES:
        raise InputError(
            f"{path} would have {size} bytes, and a baseline has at most {LARGEST_TOML_BYTES}; take fewer scenarios"
        )
    reread = reference_of(path, tomllib.loads(written))
    if any(pair.changed for pair in pairs(reread.recorded, groups)):
        raise InputError(f"{path}: its layout doesn't take the figures; {_REMEDY}")
    write_text(path, written)


def renewed(text: str, figures: str) -> str:
    """Return a baseline's text with other figures; its settings, its comments and its order stay."""
    import tomlkit

    document, fresh = tomlkit.parse(text), tomlkit.parse(figures)
    own = ("recorded", *KINDS)
    if not any(name in document for name in own):
        return f"{text.rstrip()}\n\n{figures}"
    for name in own:
        if name not in fresh:
            document.pop(name, None)
        elif name in document:
            _renew(document[name], fresh[name])
        else:
            document[name] = fresh[name]
    return tomlkit.dumps(document)


def _renew(old: MutableMapping[str, Any], new: Mapping[str, Any]) -> None:
    from tomlkit.items import Table

    for key in [key for key in old if key not in new]:
        del old[key]
    for key, value in new.items():
        if key in old and isinstance(value, Table):
            _renew(old[key], value)
        else:
            old[key] = value


def figures_text(seed: int, groups: Sequence[FigureGroup], settings: str = "") -> str:
    """Return figures as a baseline has them, with digests: a table each, but one line a trial or sensor."""
    head = f"[recorded]  # from here on: written by --update\nseed = {seed}\n"
    blocks = [_block(group) for group in groups if group.kind not in _IN_LINES]
    lines = dict.fromkeys(_IN_LINES, "")
    for group in groups:
        if group.kind in lines:
            figures = ", ".join(f"{figure} = {_value(value)}" for figure, value in group.values.items())
            lines[group.kind] += f"{quoted(group.name)} = {{ {figures} }}\n"
    blocks += [
        f"[{kind}]\n{rows}" for kind, rows in lines.items() if rows or (kind == "trials" and not lines["sensors"])
    ]
    digest = _figures_digest(tomllib.loads("\n".join([head, *blocks])))
    digests = f'{KEY} = "{digest}"  # of the figures\n{_SETTINGS_KEY} = "{settings}"  # of what stands above\n'
    return "\n".join([head + digests, *blocks])


def _block(group: FigureGroup) -> str:
    unit = f"  # {group.unit}" if group.unit else ""
    lines = [f"{figure} = {_value(value, group.labels.get(figure, ()))}\n" for figure, value in group.values.items()]
    name = group.name if _BARE.fullmatch(group.name) else quoted(group.name)
    return f"[{group.kind}.{name}]{unit}\n" + "".join(lines)


def _value(value: Value, labels: Sequence[str] = ()) -> str:
    """Return a value as TOML has it; a list with labels in lines, each with the label of its first number."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, tuple):
        return repr(value)
    if not labels:
        return f"[{', '.join(map(repr, value))}]"
    lines, width = [], max((len(repr(entry)) for entry in value), default=0)
    for i in range(0, len(value), _A_LINE):
        numbers = ", ".join(f"{entry!r:>{width}}" for entry in value[i : i + _A_LINE])
        lines.append(f"  {numbers},  # {labels[i]}, ...\n")
    return "[\n" + "".join(lines) + "]"


TOLERATED = tuple(name for name, rule in RULES.items() if rule.form != "flag")


def new_baseline(
    path: Path, *, scenarios: Sequence[str] = (), logs: Sequence[str] = (), detector: str | None = None
) -> str:
    """Return the text of a baseline without figures.

    `path`: where it will stand: its files are named from there. `scenarios`: shipped names, or files. `logs`: instead
    of scenarios: recorded flights, folders of them, or patterns. `detector`: a name of `gtmbench list`, a bank's or a
    monitor's file, or the own name of a detector in Python.
    """
    if logs:
        seen = ", ".join(quoted(_seen_from(path, source, ())) for source in logs)
        by = "auto" if detector is None else _detector_from(path, detector)
        stated = _stated([figure for figure in TOLERATED if figure in OF_LOGS])
        return _head("of_logs").format(name=printable(path.name), logs=seen, detector=quoted(by), tolerances=stated)
    strange = ("thresholds", "isolation_delay_s") if detector is None else ("threshold",)
    return _head("of_scenarios").format(
        name=printable(path.name),
        scenarios=", ".join(quoted(_seen_from(path, name, shipped_scenarios())) for name in scenarios),
        seed=load_scenario(scenarios[0]).setup.seed,
        detector='# detector = "monitor.json"'
        if detector is None
        else f"detector = {quoted(_detector_from(path, detector))}",
        tolerances=_stated([figure for figure in TOLERATED if figure not in (*strange, *OF_LOGS)]),
    )


def _head(name: str) -> str:
    return Path(__file__).with_name(f"{name}.toml").read_text(encoding="utf-8")


def _stated(figures: Sequence[str]) -> str:
    """Return tolerances as a baseline states them, a line each with what it is of."""
    lines = [f"{figure} = {json.dumps(RULES[figure].tolerance)}" for figure in figures]
    width = max(map(len, lines))
    return "\n".join(f"{line:<{width}}  # {RULES[figure].meaning}" for line, figure in zip(lines, figures, strict=True))


def _detector_from(path: Path, detector: str) -> str:
    return _seen_from(path, detector, () if is_file_of_detector(detector) else (detector,))


def is_file_of_detector(name: str) -> bool:
    """Whether a bank's or a monitor's file is meant, not a name."""
    return Path(name).suffix.lower() in (".toml", ".json")


def quoted(given: str) -> str:
    """Return a text as TOML has it."""
    # DEL is the one that TOML escapes and JSON doesn't
    return json.dumps(given, ensure_ascii=False).replace("\x7f", "\\u007f")


def _seen_from(path: Path, name: str, shipped: Collection[str]) -> str:
    """Return a shipped name, or a file's path from the folder of a baseline."""
    return name if name in shipped else Path(os.path.relpath(Path(name), path.absolute().parent)).as_posix()
