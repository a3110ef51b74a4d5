"""``gtmbench calibrate``: a detector, learnt on healthy flights."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import number
from gtmbench.cli.command import PATH, HeadedCommand, common_options
from gtmbench.cli.listing import print_bank_monitor
from gtmbench.cli.options import attitude_option, detector_option, healthy_option, healthy_part, map_option
from gtmbench.cli.output import claim_file, echo, finish, say, shown_progress
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress
from gtmbench.report.tables.envelope import envelope
from gtmbench.report.words.units import counted

if TYPE_CHECKING:
    from gtmbench.bench.sensors import Imperfections
    from gtmbench.detectors.protocol import Detector, Monitor
    from gtmbench.method.driven_attitude import Origin
    from gtmbench.values.record import Record


@click.command("calibrate", cls=HeadedCommand)
@click.argument("logs", nargs=-1, metavar="[HEALTHY_LOG ...]", type=PATH)
@map_option
@detector_option("The default is bank C.")
@click.option("--out", default="monitor.json", show_default=True, type=PATH, help="The monitor's file.")
@healthy_option("Without it, all of every log. With it, one log is learnt as `gtmbench monitor` learns it.")
@click.option(
    "--inputs", metavar="p,q,beta", help="Instead of a detector: predict from these channels or pseudo inputs ..."
)
@click.option("--outputs", metavar="r", help="... predict these sensors.")
@click.option(
    "--look", default=0.5, show_default=True, help="With --inputs and --outputs: seconds to look back and ahead."
)
@click.option("--rate", "rate_hz", type=float, help="The monitor's rate in Hz.  [default: the first log's]")
@click.option(
    "--false-alarms-per-hour",
    "rate",
    type=float,
    help="False alarms per flight hour to calibrate the whole monitor for; a detector that can't promise a rate "
    "refuses it.  [default: 0.002 for a bank, 1 for --inputs and --outputs]",
)
@click.option("--flights", type=int, help="Without logs: the number of flights to fly.  [default: 60]")
@click.option("--duration", "duration_s", type=float, help="Without logs: seconds of each flight.  [default: 500]")
@click.option("--excitation", help="A name from `gtmbench list`, or a sum of names.  [default: multisine+turbulence]")
@click.option("--aircraft", help="A name from `gtmbench list --all`, or an aircraft's folder.  [default: gtm]")
@click.option(
    "--tolerate",
    metavar="TEXT",
    help="Imperfections of healthy gyros that must not alarm: bias=0.5,wander=0.002,lag=0.005,quantum=0.05.",
)
@click.option(
    "--sensors",
    metavar="ideal|chain",
    help="Without logs: chain flies on the aircraft's own sensor chain.  [default: ideal]",
)
@click.option("--seed", default=1, show_default=True, help="Seed of the first flight, its noise and imperfections.")
@attitude_option
@click.option("--force", is_flag=True, help="Write over an existing file.")
@common_options
def calibrate_command(
    logs: tuple[Path, ...],
    detector: str | None,
    out: Path,
    healthy: tuple[str, ...],
    inputs: str | None,
    outputs: str | None,
    look: float,
    rate: float | None,
    tolerate: str | None,
    seed: int,
    force: bool,
    mapping: tuple[str, ...],
    rate_hz: float | None,
    attitude: str,
    **of_flights: Any,
) -> None:
    """Learn a detector on healthy flights, and write the monitor that `gtmbench monitor --detector` takes.

    Example: gtmbench calibrate flight.csv --healthy 0:40 --out mine.json

    It reads logs as `gtmbench monitor` does. Without logs it flies (by default the GTM) with the T2's sensor noise.
    The file holds numbers and names only; any process or machine that loads it gives the same verdicts bit for bit.
    The output states how much other flights would change the thresholds; more than three times is refused.
    """
    from gtmbench.detectors.assumptions import basis_of
    from gtmbench.detectors.monitor_file import save_monitor
    from gtmbench.report.words.monitor import facts

    if out.suffix.lower() != ".json":
        raise InputError(f"--out is '{out}'; a monitor's file ends in .json")
    claim_file(out, force=force)
    rate = 1.0 if rate is None and inputs else rate  # its residual's energy is mostly the model's error
    rate = None if rate is None else number("--false-alarms-per-hour", rate, 1e-9, 1e3)
    recipe = _recipe(detector, inputs, outputs, look)
    given = {key: value for key, value in of_flights.items() if value is not None}
    of_logs = {"--healthy": healthy, "--rate": rate_hz, "--map": mapping, "--attitude": attitude != "auto"}
    _check_kind(given, of_logs, has_logs=bool(logs))
    if logs and basis_of(recipe).is_whole:
        name = recipe.name
        raise InputError(f"'{name}' learns nothing of logs; type gtmbench monitor {logs[0]} --detector {name}")
    with shown_progress() as tell:
        lesson = _Lesson(
            recipe=recipe,
            mapping=mapping,
            rate_hz=rate_hz,
            false_alarms_per_hour=rate,
            attitude=attitude,
            tolerate=tolerate,
            seed=seed,
            tell=tell,
        )
        if healthy:
            taught = lesson.on_part(logs, healthy)
        else:
            taught = lesson.on_logs(logs) if logs else lesson.on_flights(given)
        save_monitor(taught.monitor, out)
    bank = "bank " if getattr(taught.monitor, "bank", None) else ""
    verdict = f"Calibrated {bank}{taught.monitor.name} on {taught.what}: {out}."

    def rest() -> None:
        _print_calibrated(taught)
        echo(f"monitor: {out} ({out.stat().st_size / 1000.0:.0f} kB)")

    finish(envelope("calibrate", verdict, {"out": str(out), "monitor": facts(taught.monitor)}), rest)


@dataclass(frozen=True, kw_only=True)
class _Taught:
    """A monitor, what it was learnt on, the channels of that, and whose attitude that is."""

    monitor: Monitor
    what: str
    channels: tuple[str, ...] = ()
    attitude: Origin | None = None


def _recipe(detector: str | None, inputs: str | None, outputs: str | None, look: float) -> Detector:
    """Return what is to be learnt: a detector, or a bank between channels."""
    from gtmbench.detectors.bank_detector import BankDetector
    from gtmbench.detectors.protocol import is_recipe
    from gtmbench.detectors.registry import find_detector
    from gtmbench.log.watch import bank_between

    if inputs or outputs:
        if detector is not None:
            raise InputError("both --detector and --inputs/--outputs are given; a bank has its own, so leave one out")
        if not inputs or not outputs:
            missing = "--outputs" if inputs else "--inputs"
            raise InputError(
                f"{missing} is missing: give what is predicted (--outputs r) and what from (--inputs p,q,beta)"
            )
        split = [[name.strip() for name in given.split(",") if name.strip()] for given in (inputs, outputs)]
        return BankDetector(bank=bank_between(*split, look_s=number("--look", look, 0.0, 60.0)))
    source = detector or "C"
    recipe = find_detector(source)
    if is_recipe(recipe):
        return recipe
    raise InputError(f"--detector {source} is calibrated already; give the detector it came from")


def _check_kind(of_flights: Mapping[str, object], of_logs: Mapping[str, object], *, has_logs: bool) -> None:
    """Refuse options about flights beside logs, and the other way round."""
    if has_logs and of_flights:
        option = next(iter(of_flights)).removesuffix("_s")
        raise InputError(f"--{option} is about flights, and with logs none is flown; leave out one or the other")
    for option, value in of_logs.items():
        if value and not has_logs:
            raise InputError(f"{option} is about logs, and none is given; name the logs, or leave it out")


@dataclass(frozen=True, kw_only=True)
class _Lesson:
    """What is learnt, how logs are read, and for which rate of false alarms."""

    recipe: Detector
    mapping: tuple[str, ...]
    rate_hz: float | None
    false_alarms_per_hour: float | None
    attitude: str
    tolerate: str | None
    seed: int
    tell: Progress

    def on_part(self, logs: Sequence[Path], healthy: Sequence[str]) -> _Taught:
        """Learn on a part of a log, as `gtmbench monitor` does before it watches the rest."""
        from gtmbench.detectors.protocol import is_ready
        from gtmbench.log.watch import taught_by

        if self.tolerate is not None:
            raise InputError("--tolerate is about whole logs and flights; leave out --healthy, or it")
        if len(logs) > 1:
            raise InputError(f"--healthy is a part of one log, and {len(logs)} are given; give one, or leave it out")
        given = [healthy_part(text) for text in healthy]
        spans = [part for part in given if not isinstance(part, Path)]
        if len(spans) < len(given):
            raise InputError("--healthy is a log; name logs that are healthy as a whole without --healthy")
        learnt = taught_by(
            logs[0],
            self.recipe,
            healthy=spans,
            mapping=self.mapping,
            rate_hz=self.rate_hz,
            false_alarms_per_hour=self.false_alarms_per_hour,
            attitude=self.attitude,
            progress=self.tell,
        )
        what = f"{sum(end_s - start_s for start_s, end_s in learnt.identified_s):.4g} s of {logs[0].name}"
        assert is_ready(learnt.monitor)
        return _Taught(monitor=learnt.monitor, what=what, attitude=learnt.opened.attitude)

    def on_logs(self, logs: Sequence[Path]) -> _Taught:
        """Learn on whole logs."""
        from gtmbench.log.opening.auto_bank import recipe_for_logs
        from gtmbench.study.healthy_records import logged_records

        recipe, attitude = recipe_for_logs(self.recipe, logs, self.mapping, self.attitude)
        records, origin = logged_records(
            logs,
            recipe,
            mapping=self.mapping,
            rate_hz=self.rate_hz,
            imperfections=self._imperfections,
            seed=self.seed,
            progress=self.tell,
        )
        return replace(self._calibrated(recipe, records, origin, "logs"), attitude=attitude)

    def on_flights(self, given: Mapping[str, Any]) -> _Taught:
        """Fly, and learn on these flights."""
        from gtmbench.study.healthy_records import CalibrationFlights

        tied = getattr(self.recipe, "tied_to_excitation", False)
        usual = {"flights": 2, "excitation": "dissertation"} if tied else {}
        wanted = CalibrationFlights(**{**usual, **given}, seed=self.seed, imperfections=self._imperfections)
        records = wanted.records(self.recipe, processes=os.cpu_count() or 1, progress=self.tell)
        return self._calibrated(self.recipe, records, wanted.provenance(self.recipe), "flights")

    @property
    def _imperfections(self) -> Imperfections:
        from gtmbench.bench.sensors import parse_imperfections
        from gtmbench.study.healthy_records import CalibrationFlights

        return CalibrationFlights().imperfections if self.tolerate is None else parse_imperfections(self.tolerate)

    def _calibrated(
        self, recipe: Detector, records: Sequence[Record], origin: Mapping[str, object], of: str
    ) -> _Taught:
        from gtmbench.detectors.protocol import with_provenance
        from gtmbench.detectors.statistics.thresholds import Luck

        learnt = recipe.calibrate(records, self.false_alarms_per_hour, progress=self.tell)
        monitor = with_provenance(learnt, {**origin, "records": len(records)})
        luck = Luck.from_provenance(monitor.provenance)
        if luck is not None:
            luck.check(len(records), of)
        return _Taught(monitor=monitor, what=counted(len(records), "record"), channels=records[0].channels)


def _print_calibrated(taught: _Taught) -> None:
    from gtmbench.detectors.bank_detector import BankMonitor
    from gtmbench.report.words.log import attitude_lines
    from gtmbench.report.words.monitor import origin_text

    monitor = taught.monitor
    if isinstance(monitor, BankMonitor):
        print_bank_monitor(monitor)
        say(attitude_lines(taught.attitude))
        return
    of = f" of {', '.join(taught.channels)}" if taught.channels else ""
    echo(f"{monitor.name}: calibrated on {taught.what}{of}")
    say(origin_text(monitor)[1:])
