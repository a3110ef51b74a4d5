"""The command demo: half a minute from installing to a picture."""

from __future__ import annotations

import io
import json
import shlex
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stdout
from importlib.resources import files
from pathlib import Path

import click

from gtmbench.cli.flight import fly_command
from gtmbench.cli.inject import inject_command
from gtmbench.cli.monitor import monitor_command
from gtmbench.cli.output import PATH, HeadedCommand, claim_folder, common_options, echo, finish, is_silent
from gtmbench.files.folders import atomic_folder
from gtmbench.files.plain import envelope

PAGE, RECORDING, STORY = "broken.html", "broken.rrd", "README.md"
# what is typed, and why; the last opens a window, which is left to whoever reads this
COMMANDS = (
    ("fly --out flight.csv --duration 120 --excitation multisine+turbulence --noise t2", "a healthy flight, as a log"),
    ("inject flight.csv --fault bias:q:size=3 --onset 80 --out broken.csv", "its pitch gyro reads 3 deg/s too much"),
    ("monitor flight.csv", "the healthy flight, watched"),
    (f"monitor broken.csv --report {PAGE} --record {RECORDING}", "the broken one, watched"),
    (f"view {RECORDING}", "the recording, in the rerun viewer"),
)
LIVE_FLIGHT = "--duration 90 --excitation multisine+turbulence --noise t2 --fault bias:q:size=3 --onset 60 --speed 4"
_WELL = "The broken gyro was found and named, and the healthy flight was not accused."
_STORY = "# A broken gyro, found from the sensors alone\n\n{said}\n\n```sh\n{commands}\n```\n"  # of the folder
_RUN = {"fly": fly_command, "inject": inject_command, "monitor": monitor_command}
_FOUND, _OTHERWISE = (0, 0, 0, 1), 3  # the exit codes, where all goes as it should; our own, where it doesn't


@click.command("demo", cls=HeadedCommand)
@click.option("--out", default="demo", show_default=True, type=PATH, help="The folder to write into.")
@click.option("--live", is_flag=True, help="Watch the broken flight while it flies, at four times its speed, instead.")
@click.option("--force", is_flag=True, help="Write over existing files.")
@common_options
def demo_command(out: Path, live: bool, force: bool) -> int:
    """Fly, break a gyro, watch it: half a minute, no screen and no network needed.

    Example: gtmbench demo

    The folder holds two logs, a page that a browser opens, a recording, and the five commands that made them. With
    --live nothing is written: one process sends the flight as an autopilot does, this one watches it as it comes. Exit
    code: 0 if the broken gyro was found and the healthy flight was not accused, otherwise 3.
    """
    if live:
        return _live()
    claim_folder(out, force=force)
    shows = sys.stderr.isatty() and not is_silent()
    with atomic_folder(out) as aside, chdir(aside):
        steps = [(typed, why, *_run(typed, shows=shows)) for typed, why in COMMANDS[: len(_FOUND)]]
        commands = "\n".join(f"gtmbench {typed}    # {why}" for typed, why in COMMANDS)
        said = "\n".join(f"- {why}: {lines[0]}" for _, why, _, lines in steps)
        Path(STORY).write_text(_STORY.format(said=said, commands=commands), encoding="utf-8")
    went = tuple(code for _, _, code, _ in steps) == _FOUND
    verdict = _WELL if went else f"Cannot tell: of the broken flight was said: {steps[3][-1][0]}"

    def rest() -> Iterator[str]:
        for typed, why, _, lines in steps:
            yield f"\n$ gtmbench {typed}    # {why}"
            yield "\n".join(f"  {line}" for line in lines)
        yield f"\nLook at it: open {out / PAGE} in a browser, or type: gtmbench view {out / RECORDING}"

    rows = [{"text": lines[0], "typed": f"gtmbench {typed}", "exit_code": code} for typed, _, code, lines in steps]
    own = {"out": str(out), "steps": rows}
    return finish(envelope("demo", verdict, own, exit_code=0 if went else _OTHERWISE), rest)


def _live() -> int:
    """Watch a flight that another process sends, and return the exit code."""
    from gtmbench.cli.live import live_command
    from gtmbench.link.packets import dialect

    dialect()  # without its library, that is said before anybody sends
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        link = f"udp:127.0.0.1:{free.getsockname()[1]}"
    monitor = files("gtmbench") / "baselines" / "bank-C.json"
    watching = ["live", link, "--detector", str(monitor), "--end-after", "8"]
    sending = ["fly", "--live", link, *LIVE_FLIGHT.split()]
    silent, said = is_silent(), io.StringIO()
    if not silent:
        for words, why in ((sending, "another process sends a flight"), (watching, "this one watches it")):
            echo(f"$ {shlex.join(['gtmbench', *words])}    # {why}")
    sender = subprocess.Popen([sys.executable, "-m", "gtmbench", *sending, "-q"])
    try:
        with redirect_stdout(said if silent else sys.stdout):
            given = [*watching[1:], *["--json"] * silent]
            found = int(live_command.main(given, prog_name="gtmbench live", standalone_mode=False) or 0)
    finally:
        sender.terminate()
        sender.wait()
    went = found == _FOUND[-1]
    verdict = "The broken gyro was found while it flew." if went else "Cannot tell: the broken gyro was not found."
    typed = shlex.join(["gtmbench", *watching])
    told = [json.loads(line)["verdict"] for line in said.getvalue().splitlines()]
    rows = [{"text": text, "typed": typed, "exit_code": found} for text in told]
    return finish(envelope("demo", verdict, {"out": None, "steps": rows}, exit_code=0 if went else _OTHERWISE))


def _run(typed: str, *, shows: bool) -> tuple[int, list[str]]:
    """Run a command as if it were typed; return its exit code and what it prints."""
    name, *arguments = shlex.split(typed)
    if shows:
        echo(f"$ gtmbench {typed}", err=True)
    said = io.StringIO()
    with redirect_stdout(said):
        code = _RUN[name].main(arguments, prog_name=f"gtmbench {name}", standalone_mode=False)
    return int(code or 0), said.getvalue().splitlines()
