"""The command: measure, print, write."""

from __future__ import annotations

import click

from gtmbench.cli.output import print_table

from . import commands, day, diagnosis, flight, fresh, growth, identification, peers, residual, stream
from .machine import machine
from .results import rounded, write
from .table import tables

SECTIONS = ("identification", "fresh", "commands", "peers", "residual", "norm", "flight", "growth")
ALONE = ("stream", "diagnosis", "day")  # that are only measured when asked for
ROUNDS, QUICK_ROUNDS = 7, 3


def tell(what: str) -> None:
    """Say on stderr what is being measured."""
    click.echo(what, err=True)


def measure(wanted: tuple[str, ...], *, quick: bool) -> dict:
    """Measure the wanted sections; the peers need the identification."""
    rounds = QUICK_ROUNDS if quick else ROUNDS
    results: dict = {"machine": machine()}
    if {"identification", "peers"} & set(wanted):
        tell("identification")
        results["identification"] = identification.measure(rounds)
    sections = {
        "fresh": lambda: fresh.measure(rounds),
        "commands": lambda: commands.measure(rounds),
        "peers": lambda: peers.measure(results["identification"], 1 if quick else 3, tell),
        "residual": lambda: residual.measure(rounds),
        "norm": lambda: residual.measure_norm(rounds),
        "stream": lambda: stream.measure(rounds),
        "diagnosis": lambda: diagnosis.measure(rounds),
        "day": lambda: day.measure(rounds),
        "flight": lambda: flight.measure(rounds),
        "growth": lambda: growth.measure(1 if quick else 3, 10**5 if quick else growth.SAMPLES[-1]),
    }
    for name, section in sections.items():
        if name in wanted:
            tell(name)
            results[name] = section()
    return rounded(results)


@click.command()
@click.option(
    "--only", type=click.Choice((*SECTIONS, *ALONE)), multiple=True, help="Measure this section only; repeatable."
)
@click.option("--quick", is_flag=True, help="Fewer repetitions, no size beyond 100,000 samples.")
def main(only: tuple[str, ...], *, quick: bool) -> None:
    """Print the measured ratios; all of them together are written to bench.json and into docs/reference/measured.md."""
    results = measure(only or SECTIONS, quick=quick)
    for table in tables(results):
        right = [name for name in table.columns[1:] if name != "note"]
        print_table(table.title, table.columns, table.rows, right=right)
    if not only and not quick:
        write(results)
