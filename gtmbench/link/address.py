"""The address of a port, as people write it: ``udp:HOST:PORT``, ``tcp:HOST:PORT``."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gtmbench.errors import InputError

_PORT = re.compile(
    r"(?P<kind>udp|tcp):(?P<host>\[[0-9a-fA-F:.]+\]|[^:]*):(?P<port>\d{1,5})|(?P<plain>udp):(?P<own>\d{1,5})"
)
_LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Address:
    """A port: ``udp`` or ``tcp``, a host, a number."""

    kind: str
    host: str
    port: int


def address_of(text: str) -> Address | None:
    """Return the address that a text writes, None where it writes none; without a host it is this machine.

    >>> address_of("udp:14550"), address_of("flight.tlog")
    (Address(kind='udp', host='127.0.0.1', port=14550), None)
    """
    found = _PORT.fullmatch(text)
    if found is None:
        return None
    kind, port = found["kind"] or found["plain"], int(found["port"] or found["own"])
    if not 0 <= port < 1 << 16 or (kind == "tcp" and port == 0):
        raise InputError(f"'{text}' names port {port}, which doesn't exist; ports are 1 to 65535")
    return Address(kind, (found["host"] or _LOOPBACK).strip("[]"), port)
