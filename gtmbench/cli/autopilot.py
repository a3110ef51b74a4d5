"""``gtmbench autopilot``: gains for any aircraft, found by flying it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from gtmbench.cli.aircraft import aircraft_options, at_condition, told_aircraft
from gtmbench.cli.output import claim_file, common_options, echo, print_json
from gtmbench.files.disk import atomic_write
from gtmbench.jobs.progress import progress_bar
from gtmbench.report.tables.envelope import envelope


@click.command("autopilot")
@aircraft_options
@click.option(
    "--sensors",
    default="ideal",
    show_default=True,
    metavar="ideal|chain",
    help="chain: find gains on the aircraft's own sensor chain; they go into [chain_autopilot].",
)
@click.option("--out", type=click.Path(path_type=Path), help="Also write the table [autopilot] into this file.")
@click.option("--force", is_flag=True, help="Write over an existing file.")
@common_options
def autopilot_command(
    name: str,
    altitude: float | None,
    tas: float | None,
    without_io: bool,
    sensors: str,
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Find gains of an autopilot that holds an aircraft in turbulence, by flying it.

    It takes seconds and prints a table [autopilot]. Put it into the aircraft's aircraft.toml or into a scenario; then
    `gtmbench fly --closed-loop` and `gtmbench run` fly in the loop.
    """
    from gtmbench.bench.aircraft_file import autopilot_table
    from gtmbench.bench.tuning import find_autopilot

    if out is not None:
        claim_file(out, force=force)
    aircraft = told_aircraft(name, altitude=altitude, tas=tas, without_io=without_io, silent=as_json or quiet)
    flown = at_condition(aircraft, altitude_ft=altitude, tas_kt=tas)
    flown.chain_of(sensors)
    with progress_bar(silent=as_json or quiet) as tell:
        tuned = find_autopilot(flown, sensors=sensors, progress=tell)
    text = autopilot_table(asdict(tuned.autopilot), "autopilot" if sensors == "ideal" else "chain_autopilot")
    if out is not None:
        with atomic_write(out) as aside:
            aside.write_text(text, encoding="utf-8")
    verdict = (
        f"Found gains for {aircraft.name}: in ten minutes of moderate turbulence altitude stays within "
        f"{tuned.altitude_off_ft:.0f} ft, speed within {tuned.tas_off_kt:.0f} kt, bank within {tuned.bank_deg:.1f} deg."
    )
    if as_json:
        own = {"out": None if out is None else str(out), **asdict(tuned)}
        print_json(envelope("autopilot", verdict, own))
    elif not quiet:
        echo(verdict)
        rates = ", ".join(f"{name} {rms:.2f}" for name, rms in tuned.rates_deg_s.items())
        echo(f"rates, RMS: {rates} deg/s; all gyros and angles may come {1e3 * tuned.delay_margin_s:.0f} ms later")
        if not tuned.autopilot.r_to_rudder_s:
            echo("no yaw damper: nothing answers the rudder")
        echo(text.rstrip())
        echo(f"put it into the aircraft.toml of '{aircraft.name}', or into a scenario" + (f": {out}" if out else ""))
