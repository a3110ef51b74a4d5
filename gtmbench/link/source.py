"""What a link's bytes come from: ports, standard input, files; deliveries, each with its arrival. Nothing of it is run.

What comes faster than it is watched is held up by TCP, a pipe and a serial line's driver. UDP has nobody to hold up:
the kernel keeps a little, and while the watch is busy a thread takes that over, so that only what is more than
`_MOST_WAITING` datagrams is dropped, and counted. While the watch is idle it receives by itself: a word that is handed
from thread to thread comes later and costs more.
"""

from __future__ import annotations

import os
import re
import select
import socket
import stat
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from gtmbench.errors import InputError
from gtmbench.files.writing import no_such
from gtmbench.imports import load_extra
from gtmbench.link.packets import in_tlog

TICK_S = 0.25  # how long a source waits for bytes until it says that there are none
MOST_BYTES = 1 << 16  # how much is taken at once

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
    """A source whose sender is held up while nobody takes what it sends: a pipe, a connection, a serial line.

    `file`: what is waited for, and closed. `receives`: gives bytes; none is the end, where they `end`.
    """

    def __init__(
        self,
        file: Any,
        receives: Callable[[int], bytes],
        sends: Callable[[bytes], object] = len,  # of a source that can't, nothing happens
        *,
        ends: bool = True,
    ) -> None:
        super().__init__()
        self._file, self._receives, self._sends, self._ends = file, receives, sends, ends
        self._is_closed = False

    def deliveries(self) -> Iterator[Delivery | None]:
        """Give what arrives."""
        while not self._is_closed:
            if not self._comes():
                yield None
                continue
            try:
                data = self._receives(MOST_BYTES)
            except OSError as error:
                self.ended = f"the link ended: {error.strerror or error}"
                return
            if self._ends and not data:
                return
            yield Delivery(time.time(), data)

    def send(self, data: bytes) -> None:
        """Send bytes back."""
        with suppress(OSError):
            self._sends(data)

    def close(self) -> None:
        """Receive no more."""
        self._is_closed = True
        self._file.close()

    def _comes(self) -> bool:
        """Wait a moment for bytes; tell whether there are any, or the end."""
        return bool(select.select([self._file], [], [], TICK_S)[0])


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


_MOST_WAITING = 8192  # datagrams that wait
_AT_ONCE = 256  # of them that are taken until the first is looked at
_PORT_LOOKED_S, _BEHIND_S = 0.05, 0.005  # how often the thread looks after the port; while something waits
_WAITING_S = 10.0  # for a connection


class UdpSource(LinkSource):
    """A UDP port: who sends there is answered there."""

    is_whole = True

    def __init__(self, host: str, port: int, only: str = "") -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
        self._only = only
        self._peers: dict[Peer, None] = {}
        with suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"can't listen at udp:{host}:{port}: {error.strerror or error}; is another program there? give another "
                "port, and let the sender send to it"
            ) from error
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])
        self._kept: deque[Delivery] = deque()
        self._lock = threading.Lock()
        self._is_idle = False  # the watch waits at the port itself
        self._is_closed = threading.Event()
        self._thread = threading.Thread(target=self._look_after, name="gtmbench link", daemon=True)

    def deliveries(self) -> Iterator[Delivery | None]:
        """Give what arrives."""
        self._thread.start()
        while not self._is_closed.is_set():
            with self._lock:
                self._receive()
                delivery = self._kept.popleft() if self._kept else None
                self._is_idle = delivery is None
            if delivery is not None:
                yield delivery
            elif not select.select([self._socket], [], [], TICK_S)[0]:
                yield None

    @property
    def waiting(self) -> int:
        """How many datagrams wait."""
        return len(self._kept)

    def send(self, data: bytes) -> None:
        """Answer everybody who sends here."""
        for peer in tuple(self._peers):
            with suppress(OSError):
                self._socket.sendto(data, peer)

    def close(self) -> None:
        """Close the port, and forget what waits."""
        self._is_closed.set()
        with self._lock:
            self._kept.clear()
            self._socket.close()

    def _look_after(self) -> None:
        """Take over what the kernel keeps, while the watch is busy."""
        while not self._is_closed.wait(_BEHIND_S if self._kept else _PORT_LOOKED_S):
            with self._lock:
                if not self._is_idle and not self._is_closed.is_set():
                    self._receive()

    def _receive(self) -> None:
        """Take what is there; nothing waits for anything here."""
        for _ in range(_AT_ONCE):
            try:
                # networks carry 1500 bytes; so what waits stays small, whatever is sent
                data, address = self._socket.recvfrom(4096)
            except OSError:  # nothing is left
                return
            peer = str(address[0]), int(address[1])
            if self._only and self._only not in (peer[0], f"{peer[0]}:{peer[1]}"):
                continue
            if peer not in self._peers and len(self._peers) < 8:
                self._peers[peer] = None
            if len(self._kept) >= _MOST_WAITING:
                self.dropped += 1
            else:
                self._kept.append(Delivery(time.time(), data, peer))


def _connected(host: str, port: int) -> HeldUp:
    """Return a TCP server that is connected to, such as a simulator's."""
    try:
        server = socket.create_connection((host, port), timeout=_WAITING_S)
    except OSError as error:
        raise InputError(
            f"can't connect to tcp:{host}:{port}: {error.strerror or error}; start the sender first"
        ) from error
    return HeldUp(server, server.recv, server.sendall)


def _serial_line(device: str, baud: int) -> HeldUp:
    """Return a serial line, such as a telemetry radio's or an autopilot's USB."""
    serial = load_extra("serial", "logs", "a serial line needs")
    try:
        line = serial.Serial(device, baud, timeout=0.0, write_timeout=1.0)
    except (OSError, ValueError) as error:  # its own errors are among them
        told = getattr(error, "strerror", None) or str(error)
        raise InputError(f"can't open serial:{device}:{baud}: {told}; is it plugged in, and yours to read?") from error
    return HeldUp(line, line.read, line.write, ends=False)


_LOOKED_S = 0.02  # how often a file is looked at that grows


class InputSource(HeldUp):
    """Lines on standard input."""

    is_table = True

    def __init__(self, descriptor: int | None = None) -> None:
        number = sys.stdin.fileno() if descriptor is None else descriptor
        super().__init__(os.fdopen(number, "rb", buffering=0, closefd=False), partial(os.read, number))


class GrowingSource(HeldUp):
    """Lines of a file that another program is writing: those that are there, then those to come."""

    is_table = True

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise InputError(no_such(path))
        file = path.open("rb", buffering=0)
        super().__init__(file, file.read)

    def _comes(self) -> bool:
        """Look for more until the tick is over: a file tells nobody that it grows."""
        until_s = time.monotonic() + TICK_S
        while time.monotonic() < until_s and not self._is_closed:
            size, place = os.fstat(self._file.fileno()).st_size, self._file.tell()
            if size < place:
                self.ended = f"{self._file.name} has become shorter: it was begun anew; the watch ends here"
            if size != place:
                return True
            time.sleep(_LOOKED_S)
        return False


class SavedSource(LinkSource):
    """A link that was saved as a telemetry log: as fast as it is read, or at so many times its own speed."""

    is_live, is_whole = False, True

    def __init__(self, path: Path, speed: float | None = None) -> None:
        super().__init__()
        if not path.is_file():
            raise InputError(no_such(path))
        self._content, self._speed = path.read_bytes(), speed
        if next(in_tlog(self._content[: 1 << 20]), None) is None:
            raise InputError(f"{path} holds no MAVLink packets; a telemetry log (.tlog) is read, or - for lines of CSV")

    @property
    def waiting(self) -> int:
        """How many deliveries wait: all, where nobody says how fast they come."""
        return len(self._content) if self._speed is None else 0

    def deliveries(self) -> Iterator[Delivery | None]:
        """Give what arrived."""
        begun_s, first_s = time.monotonic(), None
        for arrived_s, data in in_tlog(self._content):
            first_s = arrived_s if first_s is None else first_s
            if self._speed is not None:
                wait_s = (arrived_s - first_s) / self._speed - (time.monotonic() - begun_s)
                if wait_s > 0.0:
                    time.sleep(wait_s)
            yield Delivery(arrived_s, data)


_BAUD = 57600  # the usual rate of telemetry radios
_SERIAL = re.compile(r"serial:(?P<device>.+?)(?::(?P<baud>\d+))?")
FORMS = "udp:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD, follow:FILE.csv, - or a telemetry log (.tlog)"


def source_of(text: str, *, speed: float | None = None, only: str = "") -> LinkSource:
    """Return the source that a text names, as `FORMS` has them."""
    source = _of_others(text, only)
    if source is None:
        return _saved(Path(text), speed)
    if speed is not None:
        source.close()
        raise InputError(f"--speed is {speed:g}, and a link has a speed of its own; it is for a saved one (.tlog)")
    return source


def _of_others(text: str, only: str) -> LinkSource | None:
    """Return the source that sends by itself; None where the text names a file that was saved."""
    if text == "-":
        return InputSource()
    address = address_of(text)
    if address is not None:
        udp = address.kind == "udp"
        return UdpSource(address.host, address.port, only) if udp else _connected(address.host, address.port)
    if (serial := _SERIAL.fullmatch(text)) is not None:
        return _serial_line(serial["device"], int(serial["baud"] or _BAUD))
    if text.startswith("follow:"):
        return GrowingSource(Path(text.removeprefix("follow:")))
    if re.match(r"(udp|tcp|serial|udpin|udpout)\b:?", text) and not Path(text).exists():
        raise InputError(f"the source is '{text}'; give {FORMS}")
    return None


def _saved(path: Path, speed: float | None) -> SavedSource:
    if path.exists() and stat.S_ISFIFO(path.stat().st_mode):
        raise InputError(f"{path} is a pipe; send it to standard input: gtmbench live - < {path}")
    if path.is_file() and path.suffix.lower() != ".tlog":
        raise InputError(
            f"{path} isn't a telemetry log (.tlog); a recorded flight is watched by: gtmbench monitor {path}, "
            f"and lines that are still being written by: gtmbench live follow:{path}"
        )
    return SavedSource(path, speed)
