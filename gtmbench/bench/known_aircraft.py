"""The fleet: every aircraft that a name or a folder gives: ours, those that come with JSBSim, a user's."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import jsbsim

from gtmbench.bench.aircraft import Aircraft, aircraft_of
from gtmbench.bench.engine import check_model
from gtmbench.bench.survey import survey
from gtmbench.checks import meant, shown, text
from gtmbench.errors import InputError
from gtmbench.files.shipped import share, shipped_aircraft
from gtmbench.files.writing import is_file, read_toml

FACTS = "aircraft.toml"
_JSBSIMS = "jsbsim.toml"


def load_aircraft(name: str | Path | Aircraft, *, without_io: bool = False) -> Aircraft:
    """Return an aircraft by name (ours, or one that comes with JSBSim) or by the path of its folder.

    A folder holds ``NAME.xml``, or its ``aircraft.toml`` states the ``model``. Without an ``aircraft.toml`` its
    contents are found by trying, which takes a second or a few.

    Parameters
    ----------
    name : str, Path or Aircraft
        An aircraft is returned as it is.
    without_io : bool
        Whether to leave out the model's input and output sections, which would open files and ports. Otherwise a model
        with them is refused. For JSBSim's own aircraft they are always left out.

    Raises
    ------
    InputError
        If there is no such aircraft, or its facts are incomplete.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.load_aircraft("gtm").title
    'NASA Generic Transport Model T2 (5.5 % scale)'
    """
    if isinstance(name, Aircraft):
        return replace(name, without_io=name.without_io or without_io)
    folder = model_folder(name)
    if jsbsim_aircraft().get(folder.name) == folder:
        return aircraft_of(folder, jsbsim_facts().get(folder.name) or _surveyed(folder, without_io=True))
    path = folder / FACTS
    if not os.path.lexists(path):
        return aircraft_of(folder, _surveyed(folder, without_io=without_io))
    if not is_file(path):
        raise InputError(f"{path} isn't a file")
    facts = read_toml(path, "aircraft")
    model = facts.get("model")
    try:
        its_folder = folder if model is None else model_folder(text("model", model), beside=folder)
        aircraft = aircraft_of(its_folder, facts)
    except InputError as error:
        raise InputError(f"{path}: {error}; see the GTM's for every key") from error
    return replace(aircraft, without_io=aircraft.without_io or without_io)


def model_folder(name: str | Path, *, beside: Path | None = None) -> Path:
    """Return the folder that an aircraft's name or path means; a relative path is `beside` a folder, or here."""
    if str(name) in shipped_aircraft():
        return share() / "aircraft" / str(name)
    if known := jsbsim_aircraft().get(str(name)):
        return known
    folder = Path(os.path.realpath((beside or Path()) / name))
    if not folder.is_dir():
        names = f"{', '.join(shipped_aircraft())} and JSBSim's own (gtmbench list --all)"
        likely = meant(name, [*shipped_aircraft(), *jsbsim_aircraft()])
        raise InputError(f"no aircraft {shown(str(name))}; there are {names}, or give a folder's path{likely}")
    return folder


@cache
def jsbsim_aircraft() -> dict[str, Path]:
    """Return the folders of the aircraft that come with JSBSim, by name."""
    models = (Path(jsbsim.get_default_root_dir()) / "aircraft").glob("*/*.xml")
    return {model.stem: model.parent for model in sorted(models) if model.stem == model.parent.name}


@cache
def jsbsim_facts() -> dict[str, dict[str, Any]]:
    """Return what is known of those of JSBSim's aircraft that have a trim, by name, each as in ``aircraft.toml``."""
    return read_toml(share() / "aircraft" / _JSBSIMS, "list of aircraft")


def jsbsim_titles() -> dict[str, str]:
    """Return what each of JSBSim's aircraft is, by name; of those that have no trim, that."""
    titles = {name: facts["title"] for name, facts in jsbsim_facts().items()}
    return {
        name: titles.get(name, "JSBSim's; no trim is known") for name in sorted(jsbsim_aircraft(), key=str.casefold)
    }


def _surveyed(folder: Path, *, without_io: bool) -> dict[str, Any]:
    model = folder / f"{folder.name}.xml"
    check_model(model)
    return _survey(folder, without_io, model.stat().st_mtime_ns)


@lru_cache(maxsize=32)
def _survey(folder: Path, without_io: bool, _modified_ns: int) -> dict[str, Any]:
    """Survey a model once, as long as it stays the same."""
    return survey(folder, without_io=without_io)
