"""What ships with the package: aircraft, scenarios, banks, baselines."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parent


# those of the dissertation's section 4.4: what `gtmbench run` runs where nothing is named
MAIN_JOB = ("deadzone", "drift", "jam", "rate_saturation", "saturation")


def share() -> Path:
    """Return the folder that holds ``aircraft/`` and ``faults/``: the wheel's copy, else the checkout's."""
    return _PACKAGE / "_share" if is_installed() else _PACKAGE.parent


def shipped_aircraft() -> list[str]:
    """Return the names of the aircraft that come with the package."""
    return sorted(path.parent.name for path in (share() / "aircraft").glob("*/aircraft.toml"))


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package, by name."""
    return {path.stem: path for path in sorted((share() / "faults").glob("*.toml"))}


def shipped_banks() -> dict[str, Path]:
    """Return the banks of operators that come with the package, by name."""
    return {path.stem: path for path in sorted((_PACKAGE / "banks").glob("*.toml"))}


def shipped_baselines() -> dict[str, Path]:
    """Return the baselines of `gtmbench check` that come with the package, by name."""
    return {path.stem: path for path in sorted((_PACKAGE / "baselines").glob("*.toml"))}


def is_installed() -> bool:
    """Whether this is an installed package, not a checkout: what it ships isn't the user's to write."""
    return (_PACKAGE / "_share").is_dir()
