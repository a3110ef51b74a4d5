"""What a link's bytes come from: deliveries, each with the time of its arrival. Nothing that arrives is run."""

from __future__ import annotations

import re
import select
from collections.abc import Iterator
from dataclasses import dataclass

from gtmbench.errors import InputError

TICK_S = 0.25
"""How long a source waits for bytes until it says that there are none."""
MOST_BYTES = 1 << 16
"""How much is taken at once."""

Peer = tuple[str, int]


@dataclass(frozen=True, slots=True)
class Delivery:
    """Bytes that arrived together, when (in seconds since 1970), and from whom."""

    arrived_s: float
    data: bytes
    peer: Peer | None = None


class LinkSource:
    """Deliveries as they come: `None` now and then while there is none."""

    is_table = False
    is_live = True
    """Whether a word is waited for."""
    is_whole = False
    """Whether a delivery ends with a packet's end."""
    ended = ""
    """Why nothing comes any more, where that isn't the sender's end of it."""

    def __init__(self) -> None:
        self.dropped = 0
        """Deliveries that came faster than they were taken."""

    @property
    def waiting(self) -> int:
        """How many deliveries wait."""
        return 0

    def deliveries(self) -> Iterator[Delivery | None]:
        """Give what arrives, until nothing can any more."""
        raise NotImplementedError

    def send(self, data: bytes) -> None:
        """Send bytes back to whoever sends; of a source that can't, nothing happens."""

    def close(self) -> None:
        """Receive no more."""


class HeldUp(LinkSource):
    """A source whose sender is held up while nobody takes what it sends: a pipe, a connection, a serial line."""

    def __init__(self) -> None:
        super().__init__()
        self._is_closed = False

    def deliveries(self) -> Iterator[Delivery | None]:
        """Give what arrives."""
        while not self._is_closed:
            if not self._comes():
                yield None
                continue
            try:
                delivery = self._received()
            except OSError as error:
                self.ended = f"the link ended: {error.strerror or error}"
                return
            if delivery is None:
                return
            yield delivery

    def close(self) -> None:
        """Receive no more."""
        self._is_closed = True

    def _comes(self) -> bool:
        """Wait a moment for bytes; tell whether there are any, or the end."""
        return bool(select.select([self._descriptor()], [], [], TICK_S)[0])

    def _descriptor(self) -> int:
        """Return what is waited for."""
        raise NotImplementedError

    def _received(self) -> Delivery | None:
        """Return what came; None at the end."""
        raise NotImplementedError


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
