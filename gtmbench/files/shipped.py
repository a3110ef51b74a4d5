"""What ships with the package: aircraft, scenarios, campaigns, banks, baselines, benchmarks."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from gtmbench.errors import InputError
from gtmbench.files.writing import is_file, no_file, read_toml
from gtmbench.version import __version__

_PACKAGE = Path(__file__).parents[1]


# those of the dissertation's section 4.4: what `gtmbench run` runs where nothing is named
MAIN_JOB = ("deadzone", "drift", "jam", "rate_saturation", "saturation")


def share() -> Path:
    """Return the folder of ``aircraft/``, ``faults/``, ``experiments/``: the wheel's copy, else the checkout."""
    return _PACKAGE / "_share" if is_installed() else _PACKAGE.parent


def shipped_aircraft() -> list[str]:
    """Return the names of the aircraft that come with the package."""
    return sorted(path.parent.name for path in (share() / "aircraft").glob("*/aircraft.toml"))


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package, by name."""
    return {path.stem: path for path in sorted((share() / "faults").glob("*.toml"))}


def shipped_campaigns() -> dict[str, Path]:
    """Return the campaigns that come with the package, by name."""
    return {path.stem: path for path in sorted((share() / "experiments/campaigns").glob("*.toml"))}


def shipped_banks() -> dict[str, Path]:
    """Return the banks of operators that come with the package, by name."""
    return {path.stem: path for path in sorted((_PACKAGE / "banks").glob("*.toml"))}


def shipped_baselines() -> dict[str, Path]:
    """Return the baselines of `gtmbench check` that come with the package, by name."""
    return {path.stem: path for path in sorted((_PACKAGE / "baselines").glob("*.toml"))}


def shipped_benchmarks() -> dict[str, Path]:
    """Return the definitions of benchmarks that come with the package, by name."""
    return {path.stem: path for path in sorted((_PACKAGE / "benchmarks").glob("*.toml"))}


def read_shipped(source: str | Path, what: str, shipped: Mapping[str, Path]) -> tuple[Path, dict[str, Any]]:
    """Return the path and the tables of a TOML file that ships under a name, or that stands where the source says.

    `what`: what it should be: a scenario, a bank.
    """
    path = shipped.get(str(source), Path(source))
    if not is_file(path):
        raise InputError(no_file(source, what, shipped))
    return path, read_toml(path, what)


def is_installed() -> bool:
    """Whether this is an installed package, not a checkout: what it ships isn't the user's to write."""
    return (_PACKAGE / "_share").is_dir()


@cache
def source_digest() -> str:
    """Return a digest of the package's code and of the aircraft and banks that it ships: which one this is, in work."""
    digest = hashlib.sha256()
    files = [path for folder in (_PACKAGE, share() / "aircraft") for path in folder.rglob("*")]
    for path in sorted({path.resolve() for path in files if path.suffix in {".py", ".toml", ".xml"}}):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def code_facts(libraries: Iterable[str]) -> dict[str, str]:
    """Return what kept rows hang on beside their input: versions, and the digest of this package's code and data."""
    from importlib.metadata import version

    return {"gtmbench": __version__, "source": source_digest(), **{name: version(name) for name in libraries}}
