"""A file read by a library in a process of its own, under limits on memory and time: a broken one ends that, not us.

The libraries of some formats are C that a damaged file can bring down, and some files unpack without end. What they
read comes back as arrays and words, never as objects.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import MOST_COLUMNS, bytes_of, check_values, quiet, reading

Arrays = dict[str, NDArray[Any]]
_SPARE_BYTES, _BYTES_A_BYTE = 300 << 20, 20  # of memory: beside the file, and for each of its bytes
_LEAST_S, _BYTES_A_S = 4, 2e6  # of a processor
_LONGEST_S = 600.0  # by the clock: a busy machine may be slow
_PACKAGES = Path(__file__).resolve().parents[3]


def read_apart(reader: str, package: str, path: Path, kind: str) -> tuple[dict[str, Any], Arrays]:
    """Return the facts and arrays that the function ``arrays(path)`` of a module beside this one reads of a file."""
    if (package in sys.modules and sys.modules[package] is None) or importlib.util.find_spec(package) is None:
        raise InputError(f"{path} is a {kind}: reading it needs the package {package}; pip install 'gtmbench[logs]'")
    with reading(path, kind):
        bytes_of(path)
    environment = os.environ | {"PYTHONPATH": str(_PACKAGES), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-P", "-m", __name__, reader, str(path.absolute())]
    with tempfile.TemporaryFile() as answer:
        try:
            ended = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=answer,
                stderr=subprocess.DEVNULL,
                env=environment,
                timeout=_LONGEST_S,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            ended = -1
        answer.seek(0)
        facts = json.loads(answer.readline() or b"{}") if ended == 0 else {}
        if "names" not in facts:
            why = facts.get("error", "it is broken, or unpacks to far more than its size")
            raise InputError(f"{path} isn't a readable {kind}: {why}")
        return facts, {name: np.load(answer, allow_pickle=False) for name in facts["names"]}


def main(reader: str, path: str) -> None:
    """Write what a reader returns to stdout, under limits that suit the file's size."""
    _limit(bytes_of(Path(path)))
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as out:
        answer(reader, path, out)


def answer(reader: str, path: str, out: IO[bytes]) -> None:
    """Write what a reader returns: a line of JSON, and array after array."""
    try:
        with quiet():
            facts, arrays = import_module(f"{__package__}.{reader}").arrays(path)
        if len(arrays) > MOST_COLUMNS:
            raise InputError(f"it holds {len(arrays)} arrays; at most {MOST_COLUMNS} are read")
        check_values(sum(array.size for array in arrays.values()), "all that it holds")
    except MemoryError:
        facts, arrays = {"error": "it unpacks to far more than its size"}, {}
    except Exception as error:  # libraries raise nearly anything on garbage
        facts, arrays = {"error": one_line(str(error))[:160] or type(error).__name__}, {}
    out.write(json.dumps(facts if "error" in facts else facts | {"names": list(arrays)}).encode() + b"\n")
    for array in arrays.values():
        np.save(out, np.ascontiguousarray(array), allow_pickle=False)


def _limit(size: int) -> None:
    """Hold this process to a memory and a time that suit a file's size, where the system can."""
    try:
        import resource
    except ImportError:  # not on this system
        return
    for which, most in (
        (resource.RLIMIT_DATA, _SPARE_BYTES + _BYTES_A_BYTE * size),
        (resource.RLIMIT_CPU, round(_LEAST_S + size / _BYTES_A_S)),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(which, (most, most))


if __name__ == "__main__":
    main(*sys.argv[1:])
