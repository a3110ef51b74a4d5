"""Bank auto: of every gyro the relation that some channels allow, taken from the tables of the banks that ship."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import cache

from gtmbench.checks import listed
from gtmbench.detectors.bank.bank import Bank, ResidualSpec, bank_of, load_bank
from gtmbench.errors import InputError
from gtmbench.values.channels import GYROS, SENSORS

AUTO = "auto"
_FROM = ("C", "B")  # the better relations first
_LOOK_S = 0.5  # of operators between gyros, as `bank_between` has it


def composed_bank(channels: Iterable[str], *, attitude_from_gyros: bool = False) -> Bank:
    """Return the bank that some channels allow: of every gyro the first relation of banks C and B that they hold.

    It is judged as bank C is; with a relation that is more than kinematics (bank B's of r, which gusts spoil) over
    bank B's longer windows.

    `channels`: the measured channels that are there. `attitude_from_gyros`: whether the attitude comes from a filter
    that the gyros drive (`Bank.attitude_from_gyros`). InputError where no gyro has a relation: what is there, and what
    would be needed.

    >>> composed_bank(["phi", "theta", "psi", "p", "q"]).title
    'p and q from phi, psi and theta, as bank C'
    >>> composed_bank(["phi", "theta", "p", "q", "r"]).suspects
    ('p', 'q', 'r', 'phi', 'theta')
    """
    there = set(channels)
    taken = [found for gyro in GYROS if (found := _relation(gyro, there)) is not None]
    if not taken:
        raise InputError(_nothing(there))
    specs = tuple(spec for _, spec in taken)
    first = taken[0][0]
    judged = next((bank for bank, spec in taken if len(spec.inputs) > 1), _banks()[0])
    needs = {channel for spec in specs for channel in spec.needs}
    suspected = dict.fromkeys(name for bank, _ in taken for name in bank.suspects)
    bank = replace(
        first,
        name=AUTO,
        title=_title(taken),
        residuals=specs,
        suspects=tuple(name for name in suspected if name in needs),
        statistic=judged.statistic,
    )
    return bank.driven() if attitude_from_gyros else bank


@cache
def bank_of_gyros() -> Bank:
    """Return the bank of a log of gyros alone: each from the two others, by an operator that is identified on the log.

    No kinematics predict a gyro from others: only what an aircraft does alike again and again is predicted.

    >>> [(spec.output, spec.inputs) for spec in bank_of_gyros().residuals][0]
    ('p', ('q', 'r'))
    """
    look = {"look_back_s": _LOOK_S, "look_ahead_s": _LOOK_S}
    table = {
        "title": "each gyro from the two others, by operators that hold for flight like the part learnt from",
        "suspects": list(GYROS),
        "residuals": [
            {"output": gyro, "inputs": [other for other in GYROS if other != gyro], **look} for gyro in GYROS
        ],
        "alarm": {"statistic": "energy", "windows_s": [0.5, 2.0], "two_sided": False},
    }
    return bank_of(AUTO, table)


def unwatched(bank: Bank, channels: Collection[str], lost: Mapping[str, str] | None = None) -> dict[str, str]:
    """Say of every gyro without a residual why, a sentence each: what its relations lack among some channels.

    Why other channels are of no use is said where it is known: `lost`.

    >>> channels = ("p", "q", "r", "phi", "theta")
    >>> unwatched(composed_bank(channels), channels)
    {'r': "r isn't watched by itself: that takes psi, or alpha, beta, ny, nz and tas beside it"}
    """
    watched = {spec.output for spec in bank.diagnostic}
    return {gyro: _why_not(gyro, bank, channels, lost or {}) for gyro in GYROS if gyro not in watched}


def _why_not(gyro: str, bank: Bank, channels: Collection[str], lost: Mapping[str, str]) -> str:
    if gyro not in channels:
        why = lost.get(gyro, "it isn't there")
        return f"{gyro} isn't watched: {why}"
    itself = " by itself" if gyro in bank.suspects else ""
    return f"{gyro} isn't watched{itself}: {_lacking(gyro, channels)} beside it"


def _relations(gyro: str) -> list[tuple[Bank, ResidualSpec]]:
    return [(bank, spec) for bank in _banks() for spec in bank.diagnostic if spec.output == gyro]


@cache
def _banks() -> tuple[Bank, ...]:
    return tuple(load_bank(name) for name in _FROM)


def _relation(gyro: str, there: Collection[str]) -> tuple[Bank, ResidualSpec] | None:
    """Return the first relation of a gyro whose channels are all there, and the bank that it is from."""
    return next(((bank, spec) for bank, spec in _relations(gyro) if spec.needs <= set(there)), None)


def _title(taken: list[tuple[Bank, ResidualSpec]]) -> str:
    """Say what predicts which gyros, gyros of one bank and the same channels together."""
    groups: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for bank, spec in taken:
        groups.setdefault((bank.name, tuple(sorted(bank.sources(spec)))), []).append(spec.output)
    return "; ".join(
        f"{listed(gyros)} from {listed(sources)}, as bank {name}" for (name, sources), gyros in groups.items()
    )


def _lacking(gyro: str, there: Collection[str]) -> str:
    """Say which channels would give a gyro a relation: no choice of them that holds another."""
    missing = [spec.needs - set(there) - {gyro} for _, spec in _relations(gyro)]
    least = [lack for lack in missing if not any(other < lack for other in missing)]
    return f"that takes {', or '.join(listed(sorted(lack)) for lack in least)}"


def _nothing(there: Collection[str]) -> str:
    known = [name for name in SENSORS if name in there]
    gyros = [gyro for gyro in GYROS if gyro in there]
    if not gyros:
        return (
            f"bank {AUTO} watches gyros, and none of p, q, r is there (found: {', '.join(known) or 'no sensor'}); say "
            "with --map which columns they are, or learn others: gtmbench calibrate --inputs ... --outputs ..."
        )
    needed = "; ".join(f"for {gyro} {_lacking(gyro, there)}" for gyro in gyros)
    return (
        f"bank {AUTO} finds nothing that tells what a gyro should read (found: {', '.join(known)}): {needed}; say with "
        "--map which columns they are, or learn others: gtmbench calibrate --inputs ... --outputs ..."
    )
