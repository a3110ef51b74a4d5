"""Digests that a file carries of what it holds: a flipped bit and an altered figure are seen before they are believed.

Of JSON and TOML the digest is of the values, however they are laid out; of a Parquet file it is of every byte, in a
slot that the file's own metadata keep. They show damage and careless hands; who means to deceive can make them anew.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gtmbench.errors import InputError

KEY = "digest"
SLOT = b"sha256:" + b"0" * 64  # in what `fill_slot` takes, once
_FILLED = re.compile(rb"sha256:[0-9a-f]{64}")


def digest_of(values: Any) -> str:
    """Return a digest of plain values, as JSON or TOML holds them; the order of keys doesn't matter."""
    told = json.dumps(values, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(told.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """Return a digest of every byte of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def seal(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with the digest of all that it holds."""
    return {**document, KEY: digest_of(document)}


def check_seal(document: Mapping[str, Any], remedy: str) -> dict[str, Any]:
    """Return a table without its digest, which has to fit; `remedy` says what to do where it doesn't.

    >>> check_seal(seal({"threshold": 1.5}), "calibrate anew")
    {'threshold': 1.5}
    >>> check_seal({**seal({"threshold": 1.5}), "threshold": 2.5}, "calibrate anew")
    Traceback (most recent call last):
        ...
    gtmbench.errors.InputError: what it holds isn't what was written, by its digest: altered or damaged; calibrate anew
    """
    held = {key: value for key, value in document.items() if key != KEY}
    if document.get(KEY) != digest_of(held):
        raise altered(remedy)
    return held


def altered(remedy: str) -> InputError:
    """Return the error of a file whose digest doesn't fit."""
    return InputError(f"what it holds isn't what was written, by its digest: altered or damaged; {remedy}")


def fill_slot(content: bytes) -> bytes:
    """Return bytes whose one `SLOT` holds the digest of all of them, the slot as it was."""
    start = content.rindex(SLOT)  # rows may hold anything, and stand before the metadata
    filled = b"sha256:" + hashlib.sha256(content).hexdigest().encode()
    return content[:start] + filled + content[start + len(SLOT) :]


def is_intact(content: bytes) -> bool:
    """Whether bytes are those that `fill_slot` made."""
    found = _FILLED.findall(content)
    start = content.rindex(found[-1]) if found else 0
    return bool(found) and fill_slot(content[:start] + SLOT + content[start + len(SLOT) :]) == content
