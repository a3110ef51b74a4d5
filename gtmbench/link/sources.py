"""Where a link's bytes come from: standard input, UDP, TCP, a saved link; each delivery with the time of its arrival.

A thread does nothing but receive, so a busy watch loses nothing that a short queue can hold. What is more than that is
dropped where a sender can't be held up (UDP), and counted; others are held up. Nothing that arrives is run.
"""

from __future__ import annotations

import os
import queue
import re
import socket
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gtmbench.errors import InputError
from gtmbench.files.disk import no_such
from gtmbench.link.packets import in_tlog

_PORT = re.compile(
    r"(?P<kind>udp|tcp):(?P<host>\[[0-9a-fA-F:.]+\]|[^:]*):(?P<port>\d{1,5})|(?P<plain>udp):(?P<own>\d{1,5})"
)
_LOOPBACK = "127.0.0.1"
_MOST = 8192  # deliveries that wait
_BYTES = 1 << 16
_DATAGRAM = 4096  # bytes: networks carry 1500; so what waits stays small, whatever is sent
_TICK_S = 0.25
_WAITING_S = 10.0  # for a connection

Peer = tuple[str, int]


@dataclass(frozen=True, slots=True)
class Delivery:
    """Bytes that arrived together, when (in seconds since 1970), and from whom."""

    arrived_s: float
    data: bytes
    peer: Peer | None = None


class Source:
    """Deliveries as they come: `None` now and then while there is none."""

    is_table = False
    is_live = True
    """Whether a word is waited for."""
    is_whole = False
    """Whether a delivery ends with a packet's end."""

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


class _Received(Source):
    """A source that a thread receives from."""

    def __init__(self, receive: Callable[[], Delivery | None], *, waits: bool) -> None:
        super().__init__()
        self._receive, self._waits = receive, waits
        self._queue: queue.Queue[Delivery | None] = queue.Queue(_MOST if not waits else 64)
        self._is_closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="gtmbench link", daemon=True)

    def deliveries(self) -> Iterator[Delivery | None]:
        """Give what arrives."""
        self._thread.start()
        while not self._is_closed.is_set():
            try:
                delivery = self._queue.get(timeout=_TICK_S)
            except queue.Empty:
                yield None
                continue
            if delivery is None:
                return
            yield delivery

    @property
    def waiting(self) -> int:
        """How many deliveries wait."""
        return self._queue.qsize()

    def close(self) -> None:
        """Receive no more, and forget what waits."""
        self._is_closed.set()
        with suppress(queue.Empty):
            while True:
                self._queue.get_nowait()

    def _run(self) -> None:
        delivery: Delivery | None = Delivery(0.0, b"")
        while delivery is not None and not self._is_closed.is_set():
            try:
                delivery = self._receive()
            except TimeoutError:
                continue
            except OSError:
                delivery = None  # closed, by either side
            self._put(delivery)

    def _put(self, delivery: Delivery | None) -> None:
        while not self._is_closed.is_set():
            try:
                self._queue.put(delivery, block=self._waits or delivery is None, timeout=_TICK_S)
            except queue.Full:
                if self._waits or delivery is None:
                    continue
                self.dropped += 1
            return


class UdpSource(_Received):
    """A UDP port: who sends there is answered there.

    Parameters
    ----------
    host, port
        That are listened at.
    only : str
        The address that is believed; "" for any.
    """

    is_whole = True

    def __init__(self, host: str, port: int, only: str = "") -> None:
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
        self._socket.settimeout(_TICK_S)
        self.port = int(self._socket.getsockname()[1])
        super().__init__(self._from_socket, waits=False)

    def _from_socket(self) -> Delivery | None:
        while True:
            data, address = self._socket.recvfrom(_DATAGRAM)
            arrived_s, peer = time.time(), (str(address[0]), int(address[1]))
            if self._only and self._only not in (peer[0], f"{peer[0]}:{peer[1]}"):
                continue
            if peer not in self._peers and len(self._peers) < 8:
                self._peers[peer] = None
            return Delivery(arrived_s, data, peer)

    def send(self, data: bytes) -> None:
        """Answer everybody who sends here."""
        for peer in tuple(self._peers):
            with suppress(OSError):
                self._socket.sendto(data, peer)

    def close(self) -> None:
        """Close the port."""
        super().close()
        self._socket.close()


class TcpSource(_Received):
    """A TCP server that is connected to, such as a simulator's."""

    def __init__(self, host: str, port: int) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=_WAITING_S)
        except OSError as error:
            raise InputError(
                f"can't connect to tcp:{host}:{port}: {error.strerror or error}; start the sender first"
            ) from error
        self._socket.settimeout(_TICK_S)
        super().__init__(self._from_socket, waits=True)

    def _from_socket(self) -> Delivery | None:
        data = self._socket.recv(_BYTES)
        return Delivery(time.time(), data) if data else None

    def send(self, data: bytes) -> None:
        """Send bytes to the server."""
        with suppress(OSError):
            self._socket.sendall(data)

    def close(self) -> None:
        """Close the port."""
        super().close()
        self._socket.close()


class InputSource(_Received):
    """Lines on standard input."""

    is_table = True

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        super().__init__(self._from_input, waits=True)

    def _from_input(self) -> Delivery | None:
        data = os.read(self._descriptor, _BYTES)
        return Delivery(time.time(), data) if data else None


class SavedSource(Source):
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


def source_of(text: str, *, speed: float | None = None, only: str = "") -> Source:
    """Return the source that a text names: ``-``, ``udp:HOST:PORT``, ``tcp:HOST:PORT`` or a telemetry log's path.

    Raises
    ------
    InputError
        If it names none, or the source can't be opened.
    """
    if text == "-":
        return InputSource()
    found = _PORT.fullmatch(text)
    if found is None:
        if re.match(r"(udp|tcp|serial|follow|udpin|udpout)\b:?", text) and not Path(text).exists():
            raise InputError(f"the source is '{text}'; give udp:HOST:PORT, tcp:HOST:PORT, - or a telemetry log (.tlog)")
        return _saved(Path(text), speed)
    kind, port = found["kind"] or found["plain"], int(found["port"] or found["own"])
    host = (found["host"] or _LOOPBACK).strip("[]")
    if not 0 <= port < 1 << 16 or (kind == "tcp" and port == 0):
        raise InputError(f"the source is '{text}', and there is no port {port}; ports are 1 to 65535")
    if speed is not None:
        raise InputError(f"--speed is {speed:g}, and a link has a speed of its own; it is for a saved one (.tlog)")
    return UdpSource(host, port, only) if kind == "udp" else TcpSource(host, port)


def _saved(path: Path, speed: float | None) -> SavedSource:
    if path.exists() and stat.S_ISFIFO(path.stat().st_mode):
        raise InputError(f"{path} is a pipe; send it to standard input: gtmbench live - < {path}")
    if path.is_file() and path.suffix.lower() != ".tlog":
        raise InputError(
            f"{path} isn't a telemetry log (.tlog); a recorded flight is watched by: gtmbench monitor {path}"
        )
    return SavedSource(path, speed)
