"""What every command's ``--json`` begins with, the same for all of them (docs/reference/json.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gtmbench.files.plain import plain

SCHEMA_VERSION = 5  # the next where a key is renamed or goes; a new key needs none


def envelope(
    command: str,
    verdict: str,
    own: Mapping[str, Any],
    *,
    exit_code: int = 0,
    findings: Iterable[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Return what a command prints as one JSON-ready object: the same five keys first, then its own.

    `command`: names the schema, too: a file of ``gtmbench/schemas/``. `verdict`: the sentence that the command prints
    first without ``--json``. `own`: the command's own keys; NaN and infinities become None. `findings`: what was found,
    a row each; `text` says it in words.

    >>> list(envelope("fly", "Wrote flight.csv.", {"out": "flight.csv"}))
    ['verdict', 'exit_code', 'findings', 'schema_version', 'command', 'out']
    """
    first = {
        "verdict": verdict,
        "exit_code": exit_code,
        "findings": list(findings),
        "schema_version": SCHEMA_VERSION,
        "command": command,
    }
    return dict(plain({**first, **own}))
