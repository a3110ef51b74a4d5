"""One folder, one writer: a small file says who holds it since when, and shows a sign of life while they do.

The lock is `filelock`'s lease: of a process of this machine that is dead it is taken over at once, of another machine's
once its sign of life (the file's time, every 20 s) has stood still for a minute, watched on one's own clock. So no lock
has to be removed by hand. Readers never look at it.
"""

from __future__ import annotations

import getpass
import hashlib
import os
import platform
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from gtmbench.checks import printable
from gtmbench.errors import GtmbenchError, InputError, NoteWarning

if TYPE_CHECKING:
    from filelock import SoftFileLease

LEASE_S = 60.0  # without a sign of life, on another machine: then a holder counts as dead
FOR_EVER_S = -1.0  # as filelock takes it
_LONGEST_NAME = 200  # in bytes; systems take 255


def lock_beside(target: Path) -> Path:
    """Return where the lock of a file or a folder stands, which may not exist yet."""
    name = os.fsencode(target.name)
    told = target.name if len(name) < _LONGEST_NAME else hashlib.sha256(name).hexdigest()
    return target.parent / f".{told}.gtmbench-lock"


@contextmanager
def alone(lock: Path, what: str, *, patience_s: float = 0.0) -> Iterator[None]:
    """Keep others out while the block runs.

    `what`: who is at work where, for the one who is kept out: "another run is at work in study". `patience_s`: how long
    to wait for a holder that is alive; `FOR_EVER_S`: until it is done. Raises GtmbenchError afterwards, where somebody
    else took this one for dead meanwhile.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, alone(Path(folder, "lock"), "another run is at work"):
    ...     with alone(Path(folder, "lock"), "another run is at work"):
    ...         pass
    Traceback (most recent call last):
        ...
    gtmbench.errors.InputError: another run is at work: ...
    """
    from filelock import SoftFileLease

    lease = SoftFileLease(lock, lease_duration=LEASE_S, thread_local=False, is_singleton=False)
    _acquire(lease, lock, what, patience_s)
    try:
        _sign(lock)
        yield
    finally:
        lease.release()
    if lease.compromise is not None:
        raise GtmbenchError(
            f"{what}, too: this one had stood still for {LEASE_S:g} s, and was taken for dead; look at both"
        )


def _acquire(lease: SoftFileLease, lock: Path, what: str, patience_s: float) -> None:
    from filelock import Timeout

    _clear_unsigned(lock)
    try:
        try:
            lease.acquire(timeout=patience_s, poll_interval=0.05)
        except Timeout:
            holder = _holder(lock)
            if _silent_s(lock) < LEASE_S:
                raise InputError(f"{what}: {holder}; wait for it, or end it, or give another --out") from None
            warnings.warn(
                NoteWarning(f"{what}: {holder}; it seems dead, and is if it gives no sign for {LEASE_S:g} s"),
                stacklevel=4,
            )
            lease.acquire(timeout=2 * LEASE_S, poll_interval=0.5)
    except Timeout:
        raise InputError(f"{what}: {_holder(lock)}; it is alive, so wait for it, or give another --out") from None
    except OSError as error:
        raise InputError(
            f"can't write {lock}, which keeps others out: {error.strerror or error}; choose another place"
        ) from error


def _clear_unsigned(lock: Path) -> None:
    """Remove a lock that stays empty: its process was killed as it made it, and `filelock` would heed it for ever."""
    with suppress(OSError):  # there is none
        # a lock that says nothing for so long is nobody's: it takes a millisecond to sign one
        made, until_s = lock.stat().st_ino, time.monotonic() + 2.0
        while (now := lock.stat()).st_ino == made and now.st_size == 0:
            if time.monotonic() > until_s:
                lock.unlink()
            time.sleep(0.05)


def _sign(lock: Path) -> None:
    """Put down who holds the lock since when: lines that the lease's own reader passes over."""
    since = time.strftime("%Y-%m-%d %H:%M:%S %z")
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a number without a name, in a container
        user = "somebody"
    with suppress(OSError), lock.open("a", encoding="utf-8") as file:  # who it is can be told without, less well
        file.write(f"user={printable(user)}\nmachine={printable(platform.node())}\nsince={since}\n")


def _holder(lock: Path) -> str:
    """Say who holds a lock, as far as its file tells."""
    try:
        text = lock.read_bytes()[:1024].decode(errors="replace")
    except OSError:
        return "it has just ended"
    told = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
    since = f", since {printable(told['since'])}" if "since" in told else ""
    who = f"{told.get('user', 'somebody')} on {told.get('machine', told.get('host', 'some machine'))}"
    return f"{printable(who)}, process {printable(told.get('pid', '?'))}{since}, seen {_silent_s(lock):.0f} s ago"


def _silent_s(lock: Path) -> float:
    """Return how long ago a lock's holder gave its last sign of life, by this machine's clock; 0 where it is gone."""
    try:
        return max(time.time() - lock.stat().st_mtime, 0.0)
    except OSError:
        return 0.0
