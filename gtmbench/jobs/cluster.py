"""Tasks on a Dask cluster: its scheduler hands them to workers, and owns nothing; what comes back is written here.

A scheduler is trusted: what its workers send back is unpickled, and what they are sent is run there.
"""

from __future__ import annotations

import asyncio
import re
import socket
import ssl
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from gtmbench.checks import one_line, shown
from gtmbench.errors import GtmbenchError, InputError, NoteWarning
from gtmbench.imports import load_extra

Task = TypeVar("Task")
Result = TypeVar("Result")
_ADDRESS = re.compile(r"(tcp|tls)://([\w.:\[\]-]+):(\d{1,5})")
_AHEAD = 2  # tasks a thread that are handed out; the others wait here, not at the scheduler
_PATIENCE_S = 10.0  # in all, for a scheduler to answer
_LOOK_S = 0.02  # between two looks at what is finished
GOES_ON = "what is finished stays: go on with --resume (a benchmark: type the same again)"


class _KilledError(GtmbenchError):
    """A task has ended every worker that it was given to."""


def completed_on_cluster(
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    *,
    scheduler: str,
    tls: Path | None = None,
    killed: Callable[[Task], Result] | None = None,
) -> Iterator[tuple[int, Result]]:
    """Give what some work makes of every task as soon as it is made, as `gtmbench.jobs.processes.completed` does.

    A task whose worker dies is handed to another.

    `work`: of a task; workers import it by name.
    `scheduler`: its address, ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
    `tls`: a folder with ca.pem, cert.pem and key.pem.
    `killed`: what a task comes to that has ended every worker it was given to; without it that is an error.
    Raises GtmbenchError where the scheduler is gone, or a task has ended every worker that it was given to.
    """
    distributed = load_extra("distributed", "scale", "--scheduler needs")
    with _client(distributed, scheduler, tls) as client:
        waiting, running = enumerate(tasks), dict[Any, tuple[int, Task]]()
        while True:
            for number, task in islice(waiting, max(_most(client, scheduler) - len(running), 0)):
                running[client.submit(work, task, pure=False)] = number, task
            if not running:
                return
            for future in _done(client, list(running), scheduler):
                number, task = running.pop(future)
                try:
                    yield number, _result(distributed, future, scheduler)
                except _KilledError:
                    if killed is None:
                        raise
                    yield number, killed(task)


def check_cluster(
    scheduler: str, tls: Path | None = None, versions: Callable[[], Mapping[str, str]] | None = None
) -> None:
    """Refuse a scheduler that doesn't answer, and workers with other `versions`, which they import by name."""
    with _client(load_extra("distributed", "scale", "--scheduler needs"), scheduler, tls) as client:
        if versions is None:
            return
        here = versions()
        for worker, told in client.run(versions, on_error="return").items():
            if isinstance(told, BaseException):
                raise InputError(f"worker {worker} can't do this work ({one_line(f'{type(told).__name__}: {told}')})")
            if differs := difference(here, told):
                raise InputError(f"worker {worker} has {differs}; rows of both don't mix: install the same everywhere")


def difference(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """Say what a worker has otherwise."""
    return ", ".join(
        f"{name} {there.get(name)} instead of {own}" for name, own in here.items() if there.get(name) != own
    )


def _most(client: Any, scheduler: str) -> int:
    """Return how many tasks may be out, with the workers that there are."""
    try:
        return _AHEAD * max(int(sum(client.nthreads().values())), 1)
    except (TimeoutError, OSError, AttributeError) as error:  # it has no connection any more
        raise _gone(scheduler) from error


def _done(client: Any, futures: list[Any], scheduler: str) -> list[Any]:
    """Wait until some are done; by looking, for a client that has lost its scheduler may wait for ever."""
    lonely_s: float | None = time.monotonic() + _PATIENCE_S
    while not (done := [future for future in futures if future.done()]):
        if client.status != "running":
            raise _gone(scheduler)
        if lonely_s is not None and time.monotonic() > lonely_s:
            lonely_s = None
            if not client.nthreads():
                told = f"{scheduler} has no workers; the tasks wait for one: dask worker {scheduler} --nthreads 1"
                warnings.warn(NoteWarning(told), stacklevel=2)
        time.sleep(_LOOK_S)
    return done


def _gone(scheduler: str) -> GtmbenchError:
    return GtmbenchError(f"the scheduler at {scheduler} is gone; {GOES_ON}")


def _client(distributed: Any, scheduler: str, tls: Path | None) -> Any:
    address = _ADDRESS.fullmatch(scheduler)
    if address is None:
        raise InputError(f"--scheduler is {shown(scheduler)}; give tcp://HOST:PORT, or tls://HOST:PORT")
    scheme, host, port = address.groups()
    security = _security(distributed, scheme, tls)
    context = security.get_connection_args("client").get("ssl_context")
    _knock(scheduler, (host.strip("[]"), int(port)), context)
    try:
        return distributed.Client(scheduler, security=security, timeout=_PATIENCE_S, set_as_default=False)
    except (TimeoutError, OSError, ValueError, TypeError) as error:
        raise _silent(scheduler, one_line(str(error)) or type(error).__name__) from error


def _knock(scheduler: str, address: tuple[str, int], context: ssl.SSLContext | None) -> None:
    """Refuse who doesn't greet as a Dask scheduler does, in time: Dask's own client may wait for ever.

    A scheduler speaks first, by the number of frames of its greeting. One that wants TLS waits for the client instead.
    """
    try:
        with socket.create_connection(address, timeout=0.3 * _PATIENCE_S) as plain:
            plain.settimeout(0.5 * _PATIENCE_S)
            if context is None:
                greeting = plain.recv(8)
            else:
                with context.wrap_socket(plain, server_hostname=address[0]) as wrapped:
                    greeting = wrapped.recv(8)
    except ssl.SSLError as error:
        why = getattr(error, "verify_message", None) or error.reason or one_line(str(error))
        raise InputError(
            f"the scheduler at {scheduler} and --tls don't agree ({why}); give certificates of its own authority, or "
            "tcp:// where it has none"
        ) from error
    except (OSError, ValueError) as error:
        if context is None and isinstance(error, TimeoutError | ConnectionResetError) and _wants_tls(address):
            raise InputError(f"the scheduler at {scheduler} wants TLS; give tls://... and --tls FOLDER") from error
        raise _silent(scheduler, one_line(getattr(error, "strerror", None) or str(error))) from error
    if not 0 < int.from_bytes(greeting, "little") < 1000:  # frames; more is no greeting of Dask's
        raise _silent(scheduler, "what answers isn't a scheduler of Dask")


def _wants_tls(address: tuple[str, int]) -> bool:
    """Whether who waits there answers to a greeting of TLS."""
    asking = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    asking.check_hostname, asking.verify_mode = False, ssl.CERT_NONE  # nothing is sent or believed
    try:
        with socket.create_connection(address, timeout=0.2 * _PATIENCE_S) as plain, asking.wrap_socket(plain):
            return True
    except ssl.SSLError as error:
        return error.reason is not None and "ALERT" in error.reason
    except OSError:
        return False


def _silent(scheduler: str, why: str) -> InputError:
    return InputError(
        f"no scheduler answers at {scheduler} ({why}); start one: dask scheduler, and workers: dask worker ADDRESS "
        "--nthreads 1"
    )


def _security(distributed: Any, scheme: str, tls: Path | None) -> Any:
    """Return what a client shows and trusts: of a folder, or what Dask's own configuration names."""
    if tls is None:
        security = distributed.Security()
        if scheme == "tls" and security.tls_ca_file is None:
            raise InputError("a scheduler at tls:// wants certificates; give --tls FOLDER")
        return security
    if scheme != "tls":
        raise InputError("--tls is for a scheduler at tls://; this one is at tcp://")
    files = {name: tls / f"{name}.pem" for name in ("ca", "cert", "key")}
    missing = [path.name for path in files.values() if not path.is_file()]
    if missing:
        raise InputError(f"--tls {tls} lacks {', '.join(missing)}; give a folder with ca.pem, cert.pem and key.pem")
    return distributed.Security(
        tls_ca_file=str(files["ca"]),
        tls_client_cert=str(files["cert"]),
        tls_client_key=str(files["key"]),
        require_encryption=True,
    )


def _result(distributed: Any, future: Any, scheduler: str) -> Any:
    try:
        return future.result()
    except GtmbenchError:
        raise
    except distributed.KilledWorker as error:
        raise _KilledError(f"a task has ended every worker that it was given to (no memory?); {GOES_ON}") from error
    except (TimeoutError, OSError, CancelledError, asyncio.CancelledError) as error:
        raise _gone(scheduler) from error
    except Exception as error:
        why = one_line(f"{type(error).__name__}: {error}")
        raise GtmbenchError(f"a worker couldn't do a task ({why}); {GOES_ON}") from error
