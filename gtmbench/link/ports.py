"""Ports that a link comes in at: UDP, TCP, a serial line.

What comes faster than it is watched is held up by TCP and a serial line's driver. UDP has nobody to hold up: the kernel
keeps a little, and while the watch is busy a thread takes that over, so that only what is more than `_MOST` datagrams
is dropped, and counted. While the watch is idle it receives by itself: a word that is handed from thread to thread
comes later and costs more.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress

from gtmbench.errors import InputError
from gtmbench.imports import load_extra
from gtmbench.link.source import MOST_BYTES, TICK_S, Delivery, HeldUp, LinkSource, Peer

_MOST = 8192  # datagrams that wait
_AT_ONCE = 256  # of them that are taken until the first is looked at
_DATAGRAM = 4096  # bytes: networks carry 1500; so what waits stays small, whatever is sent
_LOOKED_S, _BEHIND_S = 0.05, 0.005  # how often the thread looks after the port; while something waits
_WAITING_S = 10.0  # for a connection


class UdpSource(LinkSource):
    """A UDP port: who sends there is answered there.

    `only`: the address that is believed; "" for any.
    """

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
        while not self._is_closed.wait(_BEHIND_S if self._kept else _LOOKED_S):
            with self._lock:
                if not self._is_idle and not self._is_closed.is_set():
                    self._receive()

    def _receive(self) -> None:
        """Take what is there; nothing waits for anything here."""
        for _ in range(_AT_ONCE):
            try:
                data, address = self._socket.recvfrom(_DATAGRAM)
            except OSError:  # nothing is left
                return
            peer = str(address[0]), int(address[1])
            if self._only and self._only not in (peer[0], f"{peer[0]}:{peer[1]}"):
                continue
            if peer not in self._peers and len(self._peers) < 8:
                self._peers[peer] = None
            if len(self._kept) >= _MOST:
                self.dropped += 1
            else:
                self._kept.append(Delivery(time.time(), data, peer))


class TcpSource(HeldUp):
    """A TCP server that is connected to, such as a simulator's."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        try:
            self._socket = socket.create_connection((host, port), timeout=_WAITING_S)
        except OSError as error:
            raise InputError(
                f"can't connect to tcp:{host}:{port}: {error.strerror or error}; start the sender first"
            ) from error

    def send(self, data: bytes) -> None:
        """Send bytes to the server."""
        with suppress(OSError):
            self._socket.sendall(data)

    def close(self) -> None:
        """Close the connection."""
        super().close()
        self._socket.close()

    def _descriptor(self) -> int:
        return self._socket.fileno()

    def _received(self) -> Delivery | None:
        data = self._socket.recv(MOST_BYTES)
        return Delivery(time.time(), data) if data else None


class SerialSource(HeldUp):
    """A serial line, such as a telemetry radio's or an autopilot's USB."""

    def __init__(self, device: str, baud: int) -> None:
        super().__init__()
        serial = load_extra("serial", "logs", "a serial line needs")
        try:
            self._serial = serial.Serial(device, baud, timeout=0.0, write_timeout=1.0)
        except (OSError, ValueError) as error:  # its own errors are among them
            told = getattr(error, "strerror", None) or str(error)
            raise InputError(
                f"can't open serial:{device}:{baud}: {told}; is it plugged in, and yours to read?"
            ) from error

    def send(self, data: bytes) -> None:
        """Send bytes to the other end."""
        with suppress(OSError):
            self._serial.write(data)

    def close(self) -> None:
        """Close the line."""
        super().close()
        self._serial.close()

    def _descriptor(self) -> int:
        return int(self._serial.fileno())

    def _received(self) -> Delivery | None:
        data = self._serial.read(MOST_BYTES)
        return Delivery(time.time(), data)
