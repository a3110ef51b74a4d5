"""``gtmbench live``: a flight watched while it flies."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number
from gtmbench.cli.options import attitude_option, detector_option, import_option, map_option, refuse
from gtmbench.cli.output import (
    PATH,
    HeadedCommand,
    check_screen,
    claim_file,
    common_options,
    echo,
    is_json,
    is_silent,
    say,
    screen_width,
    shown_progress,
)
from gtmbench.files.plain import attributes, dumps, envelope

if TYPE_CHECKING:
    from gtmbench.detectors.alarm import Alarm
    from gtmbench.link.events import LiveEvent
    from gtmbench.link.live import Live

_INTERRUPTED, _UNWRITTEN = 130, 2  # exit codes


@click.command("live", cls=HeadedCommand)
@click.argument("source", metavar="SOURCE")
@map_option
@attitude_option
@click.option("--system", type=int, help="The MAVLink system to watch, if several fly on one link.")
@detector_option("It has to be calibrated. Without one, a monitor is learnt from the link's first part.")
@import_option
@click.option(
    "--learn", "learn_s", default=60.0, show_default=True, help="Without a detector: seconds of the link to learn from."
)
@click.option("--save", type=PATH, help="Write every packet to this telemetry log (.tlog).")
@click.option("--record", type=PATH, help="Record it (.rrd) for `gtmbench view`.")
@click.option("--view", is_flag=True, help="Show readings, predictions and test statistics in the rerun viewer.")
@click.option("--say", is_flag=True, help="Send STATUSTEXT and a heartbeat back, so that ground stations show events.")
@click.option(
    "--request-rates",
    "request_hz",
    type=float,
    metavar="HZ",
    help="Ask the autopilot to send gyros and attitude so often.",
)
@click.option(
    "--key-file",
    type=PATH,
    help="A signing key: 32 bytes, 64 hexadecimal digits or a passphrase. Packets that it didn't sign are refused.",
)
@click.option(
    "--from",
    "only_from",
    default="",
    metavar="ADDRESS[:PORT]",
    help="For udp: the only address whose packets are believed.",
)
@click.option(
    "--speed", type=float, help="For a telemetry log: how many times its own speed.  [default: as fast as it is read]"
)
@click.option(
    "--end-after",
    "end_after_s",
    type=float,
    metavar="SECONDS",
    help="End after so long without a message.  [default: a udp link has no end, press Ctrl-C]",
)
@click.option("--force", is_flag=True, help="Write over an existing file.")
@common_options
def live_command(
    source: str,
    detector: str | None,
    key_file: Path | None,
    save: Path | None,
    record: Path | None,
    speed: float | None,
    view: bool,
    force: bool,
    **how: Any,  # else is as `live` takes it
) -> int:
    """Watch a flight while it flies: one line for each event, and the verdict at the end.

    Example: gtmbench live udp:127.0.0.1:14550

    SOURCE is udp:HOST:PORT (MAVLink, as a ground station gets it), tcp:HOST:PORT (connects to a simulator),
    serial:DEVICE:BAUD (a radio), a telemetry log (FILE.tlog), follow:FILE.csv (lines of a file that grows), or -
    for lines of CSV on standard input: header first, names and units as in logs. Try it with
    `gtmbench fly --live udp:127.0.0.1:14550` in another terminal.

    The monitor is the one of `gtmbench monitor`, and reads the samples as they come. At the end all that arrived is
    judged as a log: the verdict is that of `gtmbench monitor` on the saved file. With --json each event is one line
    of JSON. Nothing is sent without --say or --request-rates. Exit code: 1 something failed, 2 bad input, or what
    --save or --record write lacks something, 0 nothing found, 3 can't tell, 130 Ctrl-C (after the verdict; a second
    Ctrl-C doesn't wait for it).
    """
    _check(source, {**how, "save": save, "key_file": key_file})
    claim_file(save, force=force, option="--save", ends=[".tlog"], read=[Path(source)])
    claim_file(record, force=force, option="--record", ends=[".rrd"])
    if view:
        check_screen("--record live.rrd, and afterwards: gtmbench view live.rrd --web")
    if speed is not None:
        number("--speed", speed, 0.0, 1e6, above=True)
    from gtmbench.detectors.registry import find_detector
    from gtmbench.link.live import live, ready
    from gtmbench.link.packets import key_of
    from gtmbench.verdict.verdict import Outcome

    key = None if key_file is None else key_of(key_file)
    monitor = ready(None if detector is None else find_detector(detector))
    link = live(source, monitor, key=key, save=save, record=record, speed=speed, view=view, **how)
    interrupted = False
    with link:
        try:
            if not is_silent() and source.startswith(("udp:", "serial:", "follow:")):
                echo(f"listening at {source}; Ctrl-C ends it", err=True)
            for event in link:
                if is_json() or not is_silent():
                    _print_event(event, link)
        except KeyboardInterrupt:
            interrupted = True
        with shown_progress() as tell:
            link.close(tell)
    lost = [f"not all saved: {link.unsaved}; {save} holds what came before"] if save and link.unsaved else []
    lost += [drawn.failure for drawn in link.drawn if drawn.failure and drawn.path is not None]
    code = _INTERRUPTED if interrupted else int(link.outcome)
    if lost and code not in (Outcome.FAILED, _INTERRUPTED):
        code = _UNWRITTEN
    for each in lost:
        echo(f"gtmbench: {each}", err=True)
    _print_end(link, source, save, detector, code)
    return code


def _check(source: str, given: Mapping[str, Any]) -> None:
    is_link, is_file = source.startswith(("udp:", "tcp:", "serial:")), source.startswith("follow:")
    if is_file or source == "-":
        refuse({"--save": given["save"]}, "for MAVLink; to keep lines of CSV, put tee before the pipe")
        refuse({"--key-file": given["key_file"]}, "for MAVLink; lines of CSV carry no signature")
    else:
        why = "for lines of CSV (- and follow:); a MAVLink message states what it holds"
        refuse({"--map": given["mapping"]}, why)
    if not is_link:
        answered = {"--say": given["say"], "--request-rates": given["request_hz"]}
        refuse(answered, "for udp:, tcp: and serial:, which can be answered")
    if not source.startswith("udp:"):
        refuse({"--from": given["only_from"]}, "for udp:HOST:PORT; others have one sender")
    if not (is_link or is_file):
        refuse({"--end-after": given["end_after_s"]}, "for udp:, tcp:, serial: and follow:; others end by themselves")


def _print_event(event: LiveEvent, link: Live) -> None:
    if is_json():
        own = {key: value for key, value in event.table.items() if key != "text"}
        click.echo(dumps(envelope("live-event", event.text, own, exit_code=int(link.outcome))))
        return
    echo(str(event), bold=event.kind in ("alarm", "named"))


def _print_end(link: Live, source: str, save: Path | None, detector: str | None, code: int) -> None:
    if is_json():
        own = _ended(link, source, save)
        click.echo(dumps(envelope("live", link.verdict, own, exit_code=code, findings=_found(link))))
        return
    if not is_silent():
        say(_closing_lines(link))
        echo(f"link: {link.counts}")
        if save is not None and not link.unsaved:
            asked = "" if detector is None else f" --detector {shlex.quote(detector)}"
            echo(f"saved: {save}    look closer: gtmbench monitor {save}{asked} --details")
    for drawn in link.drawn:
        for path in () if is_silent() else drawn.paths:
            echo(f"recorded: {path}    look at it: gtmbench view {path}")
        if drawn.left_out and not is_silent():
            echo(f"note: the picture lacks {drawn.left_out} rows, which came faster than they were drawn", err=True)
        if drawn.failure and drawn.path is None:
            echo(f"note: {drawn.failure}", err=True)


def _closing_lines(link: Live) -> list[str]:
    """Return what the flight comes to, as `gtmbench monitor` says it, and the alarms that this doesn't hold."""
    from gtmbench.report.words.judgement import alarm_text
    from gtmbench.report.words.verdict import labelled, verdict_lines

    closing = link.closing
    if closing is None or closing.watched is None:
        return [link.verdict]
    doubtful = [f"unconfirmed: {alarm_text(alarm)}" for alarm in closing.unconfirmed]
    labels = [(label, text) for label, text in labelled(closing.watched) if label != "Next"]
    return [*verdict_lines(closing.verdict, labels, screen_width()), *doubtful]


def _ended(link: Live, source: str, save: Path | None) -> dict[str, object]:
    return {
        "source": source,
        "monitor": None if link.monitor is None else link.monitor.name,
        "watched_s": link.watched_s,
        "saved": None if save is None or link.unsaved else str(save),
        "recorded": [str(path) for drawn in link.drawn for path in drawn.paths],
        "link": link.counts,
    }


def _found(link: Live) -> list[dict[str, object]]:
    from gtmbench.report.words.judgement import alarm_text

    doubtful: tuple[Alarm, ...] = () if link.closing is None else link.closing.unconfirmed
    return [
        {
            "text": alarm_text(alarm),
            **attributes(alarm, "time_s", "onset_s", "sensor", "candidates", "ended_s"),
            "is_confirmed": alarm.accuses and not any(alarm is each for each in doubtful),
        }
        for alarm in link.alarms
    ]
