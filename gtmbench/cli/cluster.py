"""The options of a Dask cluster."""

from __future__ import annotations

from pathlib import Path

import click

from gtmbench.cli.output import F
from gtmbench.errors import InputError


def cluster_options(command: F) -> F:
    """Give a command ``--scheduler`` and ``--tls``."""
    tls = click.option(
        "--tls",
        type=click.Path(path_type=Path),
        metavar="FOLDER",
        help="With --scheduler: the folder of ca.pem, cert.pem and key.pem.",
    )
    where = "Run the tasks on a Dask cluster: tcp://HOST:PORT, tls://..."
    return click.option("--scheduler", metavar="ADDRESS", help=where)(tls(command))


def check_cluster_options(scheduler: str | None, tls: Path | None) -> None:
    """Refuse certificates of no scheduler."""
    if tls is not None and scheduler is None:
        raise InputError("--tls is for a --scheduler, and none is given")
