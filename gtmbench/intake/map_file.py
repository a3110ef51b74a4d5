"""How a log's columns are read, kept in a file: for the next log of the same logger."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from pathlib import Path

from gtmbench.checks import naming, shown
from gtmbench.errors import InputError
from gtmbench.files.disk import atomic_write, check_size, is_file, no_such
from gtmbench.intake.flight_log import Source

_LARGEST_BYTES = 1 << 20
_HEAD = "# CHANNEL = COLUMN:UNIT, as --map takes them; gtmbench monitor LOG --map {}"


def read_map_file(path: Path) -> list[str]:
    """Return a file's columns as texts ``CHANNEL=COLUMN:UNIT``."""
    if not is_file(path):
        raise InputError(no_such(path))
    check_size(path, "file of columns", _LARGEST_BYTES)
    with naming(path):
        try:
            columns = tomllib.loads(path.read_text(encoding="utf-8")).get("columns", {})
        except (ValueError, RecursionError) as error:
            raise InputError(f"it isn't TOML: {error}") from error
        wrong = (
            [name for name, text in columns.items() if not isinstance(text, str)] if isinstance(columns, dict) else []
        )
        if not isinstance(columns, dict) or not columns or wrong:
            raise InputError(
                f'it is {shown(columns)}; a file of columns has lines such as p = "gyro_x:rad/s" in [columns]'
            )
        return [f"{channel}={text}" for channel, text in columns.items()]


def write_map_file(sources: Iterable[Source], path: Path) -> None:
    """Write how columns are read, those that were guessed like those that are known.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_map_file([Source(channel="nz", column="az", unit="g", sign=-1.0)], Path(folder, "columns.toml"))
    ...     read_map_file(Path(folder, "columns.toml"))
    ['nz=-az:g']
    """
    import tomlkit

    columns = {source.channel: source.typed for source in sources if source.column}
    with atomic_write(path) as aside:
        aside.write_text(f"{_HEAD.format(path.name)}\n{tomlkit.dumps({'columns': columns})}", encoding="utf-8")
