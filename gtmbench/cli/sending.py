"""Where a flown flight goes: into a log, or sent live to `gtmbench live`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gtmbench.checks import number
from gtmbench.cli.output import claim_file, echo
from gtmbench.errors import InputError

if TYPE_CHECKING:
    from gtmbench.faults.fault import Fault
    from gtmbench.values.record import Record


def check_destination(out: Path | None, target: str | None, speed: float | None, *, force: bool) -> None:
    """Refuse a flight that goes nowhere, and a log or a receiver that can't be one."""
    if out is None and target is None:
        raise InputError("the flight goes nowhere: give --out flight.csv, or --live udp:127.0.0.1:14550 to send it")
    if speed is not None:
        number("--speed", speed, 0.0, 1e4, above=True)
        if target is None:
            raise InputError(f"--speed is {speed:g}, and nothing is sent; add --live udp:127.0.0.1:14550")
    if target is not None:
        from gtmbench.link.sending import udp_address

        udp_address(target)
    if out is not None:
        from gtmbench.files.logs import check_log_path

        check_log_path(out)
        claim_file(out, force=force)


def broken(record: Record, faults: Sequence[Fault]) -> Record:
    """Return the readings with faults in them, which no loop has flown."""
    from gtmbench.faults.fault import inject

    for fault in faults:
        record = inject(record, fault)
    return record


def deliver(record: Record, out: Path | None, target: str | None, speed: float | None, *, silent: bool) -> str:
    """Write a flight, send it, or both, and return what to say about it."""
    said = []
    if out is not None:
        from gtmbench.files.logs import write_log

        write_log(record, out)
        said.append(f"Wrote {out}: {len(record)} samples of {len(record.channels)} channels, {record.end_s:g} s.")
    if target is not None:
        from gtmbench.link.sending import send_live

        speed = 1.0 if speed is None else speed
        if not silent and sys.stderr.isatty():
            echo(f"sending {record.end_s:g} s to {target} at {speed:g} times real time; Ctrl-C ends it", err=True)
        send_live(record, target, speed=speed)
        said.append(f"Sent {len(record)} samples of {record.end_s:g} s to {target}.")
    return " ".join(said)
