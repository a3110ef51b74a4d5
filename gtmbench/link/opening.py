"""The source that a text names."""

from __future__ import annotations

import re
import stat
from pathlib import Path

from gtmbench.errors import InputError
from gtmbench.link.ports import SerialSource, TcpSource, UdpSource
from gtmbench.link.source import LinkSource, address_of
from gtmbench.link.streams import GrowingSource, InputSource, SavedSource

_BAUD = 57600
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
        return UdpSource(address.host, address.port, only) if udp else TcpSource(address.host, address.port)
    if (serial := _SERIAL.fullmatch(text)) is not None:
        return SerialSource(serial["device"], int(serial["baud"] or _BAUD))
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
