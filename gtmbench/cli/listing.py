"""``gtmbench list``: every name that there is. Nothing is imported for it: names.toml holds what Python would say."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import click

from gtmbench.cli.banks import show_bank
from gtmbench.cli.command import HeadedCommand
from gtmbench.cli.output import common_options, echo, print_json
from gtmbench.errors import InputError
from gtmbench.files.disk import read_toml
from gtmbench.files.shipped import share, shipped_aircraft, shipped_banks, shipped_campaigns, shipped_scenarios
from gtmbench.imports import DETECTORS, FAULTS, installed
from gtmbench.report.tables.envelope import envelope
from gtmbench.values.channels import CHANNELS


@click.command("list", cls=HeadedCommand)
@click.argument("name", required=False, metavar="[BANK|FILE.toml|MONITOR.json]")
@click.option(
    "--of", "log", type=click.Path(path_type=Path), metavar="LOG", help="For bank auto: the log it is made of."
)
@click.option("--all", "with_all", is_flag=True, help="Also list the aircraft that come with JSBSim.")
@common_options
def list_command(name: str | None, log: Path | None, with_all: bool, as_json: bool, quiet: bool) -> None:
    """List every name that there is to type, or show what one bank of detectors can isolate.

    Example: gtmbench list C

    Without a name: aircraft, channels, excitations, faults, scenarios, campaigns, detectors, banks, pseudo inputs. Of
    a bank: its residuals, which fault enters which, and its blind spots; of a monitor's file also its calibration and
    the faults that it can't detect. `auto --of LOG` is the bank that a log's channels allow.
    """
    if name is not None:
        show_bank(name, log, as_json=as_json, quiet=quiet)
        return
    if log is not None:
        raise InputError(f"--of {log} goes with bank auto: gtmbench list auto --of LOG")
    sections = listing()
    if with_all:
        from gtmbench.bench.known_aircraft import jsbsim_titles

        sections["aircraft"] |= jsbsim_titles()
    counts = ", ".join(f"{len(entries)} {_title(key)}" for key, entries in sections.items())
    verdict = f"There are {counts}."
    if as_json:
        print_json(envelope("list", verdict, sections))
    elif not quiet:
        echo(verdict)
        for title, entries in sections.items():
            echo(_title(title), bold=True)
            width = max(map(len, entries), default=0)
            for name, meaning in entries.items():
                echo(f"  {name:<{max(width, 16)}} {meaning}")
            if title == "aircraft" and not with_all:
                known = read_toml(share() / "aircraft/jsbsim.toml", "list of aircraft")
                echo(f"  and {len(known)} that come with JSBSim (--all), or a folder of yours")


def _title(key: str) -> str:
    return key.replace("_", " ")


def listing() -> dict[str, dict[str, str]]:
    """Return what there is, section by section: names, and what each is in a line."""
    told = tomllib.loads((files("gtmbench.cli") / "names.toml").read_text(encoding="utf-8"))
    banks = _titles(shipped_banks())
    detectors = (
        told["detectors"] | banks | told["rivals"] | told["surfaces"]
    )  # in the order in which a name is looked up
    return {
        "aircraft": _titles({name: share() / "aircraft" / name / "aircraft.toml" for name in shipped_aircraft()}),
        "channels": {c.name: f"{c.unit}, {c.meaning}" for c in CHANNELS.values()},
        "excitations": told["excitations"],
        "faults": told["faults"] | _installed(FAULTS),
        "scenarios": _titles(shipped_scenarios()),
        "campaigns": _titles(shipped_campaigns()),
        "detectors": detectors | {name: of for name, of in _installed(DETECTORS).items() if name not in detectors},
        "banks": banks,
        "pseudo_inputs": told["pseudo_inputs"],
    }


def _titles(paths: Mapping[str, Path]) -> dict[str, str]:
    return {name: read_toml(path, "file that ships")["title"] for name, path in paths.items()}


def _installed(group: str) -> dict[str, str]:
    return {name: f"installed: {place}" for name, place in installed(group).items()}
