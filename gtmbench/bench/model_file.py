"""An aircraft's XML, looked at before JSBSim reads it: it may do more than describe an aircraft."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any
from xml.parsers import expat

from gtmbench.errors import InputError
from gtmbench.files import check_size, is_file

_LARGEST_BYTES = 20_000_000
_DEEPEST = 100  # elements in elements: JSBSim's reader calls itself
_REACH_OUT = ("input", "output")  # JSBSim would write files anywhere, listen on ports and connect to hosts


def check_model(path: Path) -> None:
    """Refuse a model, and what it includes from its folder, that isn't whole or reaches outside.

    Raises
    ------
    InputError
        Naming the file and what is wrong with it.
    """
    if not is_file(path):
        raise InputError(f"{path}: no such file; an aircraft's folder NAME holds its model, NAME.xml")
    for name in _checked(path):
        if {"/", ".."}.intersection(PurePosixPath(name.replace("\\", "/")).parts):
            raise InputError(f"{path} includes '{name}'; a model's parts stand in its own folder")
        part = path.parent / name
        part = part if part.suffix == ".xml" else Path(f"{part}.xml")
        if part.exists():
            if not is_file(part):
                raise InputError(f"{path} includes {part}, which isn't a file")
            _checked(part)


def _checked(path: Path) -> list[str]:
    """Return the names of the files that a file includes."""
    open_elements: list[str] = []
    included: list[str] = []

    def begin(name: str, attributes: dict[str, str]) -> None:
        if len(open_elements) == 1 and name in _REACH_OUT:
            raise InputError(f"{path} has an <{name}> section, which would reach outside (files, ports); take it out")
        open_elements.append(name)
        if len(open_elements) > _DEEPEST:
            raise InputError(f"{path} has elements in elements, more than {_DEEPEST} deep; no model needs that")
        if "file" in attributes:
            included.append(attributes["file"])

    def end(_: str) -> None:
        open_elements.pop()

    def declares(*_: Any) -> None:
        raise InputError(f"{path} declares a document type; a model needs no entities, take it out")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = declares
    check_size(path, "model", _LARGEST_BYTES)
    try:
        parser.Parse(path.read_bytes(), True)
    except InputError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:  # the last two: an encoding that nobody knows
        raise InputError(f"{path} isn't whole XML: {error}") from error
    return included
