"""Tasks on a Dask cluster: its scheduler hands them to workers, and owns nothing; what comes back is written here.

A scheduler is trusted: what its workers send back is unpickled, and what they are sent is run there.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from gtmbench.checks import one_line, shown
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.imports import load_extra

Task = TypeVar("Task")
Result = TypeVar("Result")
_ADDRESS = re.compile(r"(tcp|tls)://[\w.:\[\]-]+:\d{1,5}")
_AHEAD = 2  # tasks a thread that are handed out; the others wait here, not at the scheduler
_PATIENCE_S = 10
_LOOK_S = 0.02
_GOES_ON = "what is finished stays: go on with --resume"


def completed_on_cluster(
    work: Callable[[Task], Result], tasks: Iterable[Task], *, scheduler: str, tls: Path | None = None
) -> Iterator[tuple[int, Result]]:
    """Give what some work makes of every task as soon as it is made, as `gtmbench.processes.completed` does.

    A task whose worker dies is handed to another.

    Parameters
    ----------
    work : callable
        Of a task; workers import it by name.
    tasks : iterable
    scheduler : str
        Its address, ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
    tls : Path, optional
        A folder with ca.pem, cert.pem and key.pem.

    Raises
    ------
    InputError
        Where no scheduler answers there.
    GtmbenchError
        Where the scheduler is gone, or a task has ended every worker that it was given to.
    """
    distributed = load_extra("distributed", "scale", "--scheduler needs")
    with _client(distributed, scheduler, tls) as client:
        waiting, running = enumerate(tasks), dict[Any, int]()
        while True:
            for number, task in islice(waiting, max(_most(client, scheduler) - len(running), 0)):
                running[client.submit(work, task, pure=False)] = number
            if not running:
                return
            for future in _done(client, list(running), scheduler):
                yield running.pop(future), _result(distributed, future, scheduler)


def check_cluster(scheduler: str, tls: Path | None = None) -> None:
    """Refuse a scheduler that doesn't answer: before the long work, not after it.

    Raises
    ------
    InputError
    """
    with _client(load_extra("distributed", "scale", "--scheduler needs"), scheduler, tls):
        pass


def _most(client: Any, scheduler: str) -> int:
    """Return how many tasks may be out, with the workers that there are."""
    try:
        return _AHEAD * max(int(sum(client.nthreads().values())), 1)
    except (TimeoutError, OSError, AttributeError) as error:  # it has no connection any more
        raise _gone(scheduler) from error


def _done(client: Any, futures: list[Any], scheduler: str) -> list[Any]:
    """Wait until some are done; by looking, for a client that has lost its scheduler may wait for ever."""
    while not (done := [future for future in futures if future.done()]):
        if client.status != "running":
            raise _gone(scheduler)
        time.sleep(_LOOK_S)
    return done


def _gone(scheduler: str) -> GtmbenchError:
    return GtmbenchError(f"the scheduler at {scheduler} is gone; {_GOES_ON}")


def _client(distributed: Any, scheduler: str, tls: Path | None) -> Any:
    if not _ADDRESS.fullmatch(scheduler):
        raise InputError(f"--scheduler is {shown(scheduler)}; give tcp://HOST:PORT, or tls://HOST:PORT")
    try:
        return distributed.Client(
            scheduler, security=_security(distributed, tls), timeout=_PATIENCE_S, set_as_default=False
        )
    except (TimeoutError, OSError, ValueError, TypeError) as error:
        raise InputError(
            f"no scheduler answers at {scheduler} ({one_line(str(error)) or type(error).__name__}); start one: dask "
            "scheduler, and workers: dask worker ADDRESS --nthreads 1"
        ) from error


def _security(distributed: Any, tls: Path | None) -> Any:
    if tls is None:
        return None
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
        raise GtmbenchError(f"a task has ended every worker that it was given to (no memory?); {_GOES_ON}") from error
    except (TimeoutError, OSError, CancelledError, asyncio.CancelledError) as error:
        raise _gone(scheduler) from error
    except Exception as error:
        why = one_line(f"{type(error).__name__}: {error}")
        raise GtmbenchError(f"a worker couldn't do a task ({why}); {_GOES_ON}") from error
