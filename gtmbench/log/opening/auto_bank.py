"""Bank auto for logs: the relations that every one of them allows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from gtmbench.checks import naming
from gtmbench.detectors.bank.composed import bank_of_gyros, composed_bank, unwatched
from gtmbench.detectors.bank_detector import AutoDetector, BankDetector
from gtmbench.detectors.protocol import Detector
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_contents
from gtmbench.intake.names import guess
from gtmbench.intake.open import open_log
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.log.opening.driven_attitude import (
    FROM_LOG,
    check_attitude,
    origin_in_logs,
    rests_on_attitude,
    with_origin,
)
from gtmbench.method.driven_attitude import Origin
from gtmbench.values.channels import ATTITUDE, GYROS


def bank_for_logs(
    logs: Sequence[Path | ReadLog], mapping: Sequence[str], origin: Origin | None = None
) -> tuple[BankDetector, dict[str, str]]:
    """Return the bank that logs allow, and why it doesn't watch which gyros; of gyros alone, one between these.

    `logs`: the first is the one that the bank is for. `origin`: whether the gyros drive the attitude; without it, as
    `origin_in_logs` finds it.
    """
    reads = [read_log(log) for log in logs]
    contents = [log_contents(read, mapping=mapping) for read in reads]
    there = [name for name in contents[0].usable if all(name in each.usable for each in contents)]
    for read, content in zip(reads, contents, strict=True):
        if not set(GYROS) & set(content.usable):
            named = [channel.name for channel in content.channels if channel.name in GYROS]
            open_log(read, mapping=mapping, needs=named or GYROS)  # says what is wrong with them
    doubts = [each for content in contents for each in content.columns if each.why_not]
    lost = {guess(each.name).channel: f"column '{each.name}' {each.why_not}" for each in doubts}
    lost |= {each.name: each.why_not for content in contents for each in content.channels if each.why_not}
    with naming(reads[0].path):
        if contents[0].no_time:
            raise InputError(contents[0].no_time)
        if set(GYROS) <= set(there) and not {"phi", "theta"} & {*there, *lost}:  # a heading alone tells no gyro's rate
            return BankDetector(bank=bank_of_gyros()), {}
        try:
            composed_bank(there)  # refused before samples are looked at
        except InputError as error:
            unusable = [f"{name}: {lost[name]}" for name in ATTITUDE if name in lost]
            raise InputError("; ".join((str(error), *unusable))) from error
    known = origin_in_logs(reads, mapping) if origin is None else origin
    bank = composed_bank(there, attitude_from_gyros=known.is_driven)
    return BankDetector(bank=bank), unwatched(bank, there, lost)


def recipe_for_logs(
    recipe: Detector,
    logs: Sequence[Path | ReadLog],
    mapping: Sequence[str],
    attitude: str = FROM_LOG,
) -> tuple[Detector, Origin | None]:
    """Return a recipe as logs, all of them healthy, allow it and their attitude wants it, and what that is.

    None where it doesn't rest on one.
    """
    check_attitude(attitude)
    if not isinstance(recipe, AutoDetector) and not rests_on_attitude(recipe):
        return recipe, None
    reads = [read_log(log) for log in logs]
    origin = origin_in_logs(reads, mapping, attitude=attitude, spans=[(-math.inf, math.inf)])
    if isinstance(recipe, AutoDetector):
        recipe, _ = bank_for_logs(reads, mapping, origin)
    return (with_origin(recipe, origin), origin) if rests_on_attitude(recipe) else (recipe, None)
