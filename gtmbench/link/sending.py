"""A flight sent as an autopilot sends it: MAVLink's ATTITUDE and HIGHRES_IMU, in real time or faster."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.link.packets import SavedLink, dialect
from gtmbench.link.source import Address, address_of
from gtmbench.values.channels import ATTITUDE, G_M_S2, GYROS
from gtmbench.values.record import Record, check_record

_SYSTEM = 1


def send_live(record: Record, target: str | Path, *, speed: float = 1.0) -> None:
    """Send a record as an autopilot sends its flight, or write it as a ground station would have received it.

    Every sample becomes HIGHRES_IMU and ATTITUDE, and every second a HEARTBEAT of system 1.

    Parameters
    ----------
    record : Record
        With p, q, r, phi, theta and psi; not sent: samples that are missing.
    target : str or Path
        ``udp:HOST:PORT``, or the telemetry log to write (.tlog), at once.
    speed : float
        How many times real time.

    Raises
    ------
    InputError
        If the record lacks a channel, or the target is neither.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> record = gb.Record([[0.0] * 6] * 500, channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.send_live(record, Path(folder, "flight.tlog"))
    ...     gb.open_log(Path(folder, "flight.tlog")).sample_period_s
    0.01
    """
    check_record(record)
    record.columns((*GYROS, *ATTITUDE))
    number("speed", speed, 0.0, 1e4, above=True)
    if isinstance(target, Path) or not target.startswith("udp:"):
        path = Path(target)
        if path.suffix.lower() != ".tlog":
            raise InputError(f"the target is '{target}'; give udp:HOST:PORT, or a telemetry log's name (.tlog)")
        began_s = time.time()
        with SavedLink(path) as saved:
            for time_s, packet in _packets(record):
                saved.put(began_s + time_s, packet)
        return
    address = udp_address(target)
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    with contextlib.closing(socket.socket(family, socket.SOCK_DGRAM)) as sender:
        began_s = time.perf_counter()
        for time_s, packet in _packets(record):
            while (wait_s := time_s / speed - (time.perf_counter() - began_s)) > 0.0:
                time.sleep(min(wait_s, 0.002))
            with contextlib.suppress(ConnectionError):  # nobody listens yet
                sender.sendto(packet, (address.host, address.port))


def udp_address(target: str) -> Address:
    """Return the UDP port that is sent to.

    >>> udp_address("udp:127.0.0.1:14550").port
    14550
    """
    address = address_of(target)
    if address is None or address.kind != "udp" or address.port == 0:
        raise InputError(f"the target is '{target}'; give udp:HOST:PORT, such as udp:127.0.0.1:14550")
    return address


def _packets(record: Record) -> Iterator[tuple[float, bytes]]:
    """Give when each packet is sent, in seconds since the first sample, and its bytes."""
    mavlink = dialect()
    sender = mavlink.MAVLink(None, srcSystem=_SYSTEM, srcComponent=1)
    rates, angles = np.radians(record.matrix(GYROS)), np.radians(record.matrix(ATTITUDE))
    angles = np.column_stack([angles[:, :2], np.remainder(angles[:, 2] + np.pi, 2.0 * np.pi) - np.pi])
    forces = [record[name] * G_M_S2 if name in record else np.full(len(record), np.nan) for name in ("nx", "ny", "nz")]
    pushed = np.column_stack([forces[0], forces[1], -forces[2]]).tolist()
    per_second = max(round(1.0 / record.sample_period_s), 1)

    def packed(message: object) -> bytes:
        content = bytes(message.pack(sender))  # type: ignore[attr-defined]
        sender.seq = (sender.seq + 1) % 256
        return content

    for row, (rate, angle) in enumerate(zip(rates.tolist(), angles.tolist(), strict=True)):
        since_s = round(row * record.sample_period_s, 9)
        at_s = since_s + 10.0  # since the autopilot was switched on
        if row % per_second == 0:
            yield since_s, packed(mavlink.MAVLink_heartbeat_message(1, 12, 0, 0, 4, 3))
        if np.isfinite(rate).all():
            told = (*pushed[row], *rate, 0.2, 0.0, 0.4, 1013.0, 0.0, 0.0, 20.0, 63, 0)
            yield since_s, packed(mavlink.MAVLink_highres_imu_message(round(at_s * 1e6), *told))
        if np.isfinite(angle).all():
            yield since_s, packed(mavlink.MAVLink_attitude_message(round(at_s * 1e3), *angle, *rate))
