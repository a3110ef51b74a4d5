"""A command as gtmbench has it: its options under headings, and old names that say where they went."""

from __future__ import annotations

from collections.abc import Sequence

import click

_APART = {  # the heading of options that few need
    "Long runs": ("--resume", "--time-limit", "--scheduler", "--tls"),
    "An aircraft's history": ("--history", "--aircraft-id"),
    "Faults of your own": ("--import",),
    "Help, files that exist": ("--force", "-h"),
}
_ALIASES = {"--identify": "--healthy"}  # old names that work
_CALIBRATE = "gtmbench calibrate LOG {} ..., then gtmbench monitor LOG --detector monitor.json"
_SCOPE = "gb.watch_log in Python takes attitude="
_MOVED_OPTIONS = {
    "monitor": {
        **dict.fromkeys(("--inputs", "--outputs", "--look"), _CALIBRATE.format("--inputs p,q,beta --outputs r")),
        "--false-alarms-per-hour": _CALIBRATE.format("--healthy T0:T1 --false-alarms-per-hour RATE"),
        "--attitude": f"{_CALIBRATE.format('--attitude own|driven')}; or {_SCOPE}",
        "--save": "gtmbench calibrate LOG --healthy T0:T1 --out monitor.json",
        "--named": "--details",
        "--all": "--list --details",
        "--figure": "--report FIGURE.png",
        "--map-file": "--map FILE.toml",
        "--calibrated": "--detector FILE.py:OBJECT@FILE.json",
    },
    "score": {"--attitude": _SCOPE, "--map-file": "--map FILE.toml"},
}


_MOVED_COMMANDS = {
    "bank": "gtmbench list BANK|MONITOR.json",
    "trim": "gtmbench aircraft NAME",
    "autopilot": "gtmbench aircraft NAME --autopilot",
    "new": "gtmbench run --new NAME.toml; or, of an aircraft, gtmbench aircraft NAME --facts",
    "report": "gtmbench campaign DIR --report html",
    "rescue": "gtmbench fly --rescue",
    "diff": "gtmbench verify A.rrd --against B.rrd",
}


class HeadedCommand(click.Command):
    """A command whose help has headings."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse a command line, in which old names of options work."""
        return super().parse_args(ctx, [_renamed(word) for word in args])

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, those that few need apart."""
        apart = {name: heading for heading, names in _APART.items() for name in names}
        sections: dict[str, list[tuple[str, str]]] = {"Options": [], **{heading: [] for heading in _APART}}
        for option in self.get_params(ctx):
            record = option.get_help_record(ctx) if isinstance(option, click.Option) else None
            if record is not None:
                # click keeps the names of --help in a set: either may come first
                sections[next((apart[name] for name in option.opts if name in apart), "Options")].append(record)
        for heading, records in sections.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def moved_command(given: Sequence[str]) -> str:
    """Say what is typed instead of a command of old; "" where it never was one."""
    old = next((word for word in given if not word.startswith("-")), "")
    return f"gtmbench {old} has moved: {_MOVED_COMMANDS[old]}" if old in _MOVED_COMMANDS else ""


def moved_option(command: str, option: str) -> str:
    """Return what is typed instead of an option that a command no longer has; "" where it never had it."""
    return _MOVED_OPTIONS.get(command, {}).get(option, "")


def _renamed(word: str) -> str:
    name, equals, value = word.partition("=")
    return f"{_ALIASES.get(name, name)}{equals}{value}"
