"""A JSBSim model's files: what is refused before JSBSim reads them, and a copy without what would reach outside."""

from __future__ import annotations

import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any
from xml.parsers import expat

from gtmbench.errors import InputError
from gtmbench.files.writing import check_size, is_file

_LARGEST_BYTES = 20_000_000
_DEEPEST = 100  # elements in elements: JSBSim's reader calls itself
_REACH_OUT = ("input", "output")  # JSBSim would write files anywhere, listen on ports and connect to hosts


def check_model(path: Path) -> tuple[str, ...]:
    """Refuse a model that isn't whole or leads out of its folder; return its sections that would reach outside."""
    if not is_file(path):
        others = sorted(there.name for there in path.parent.glob("*.xml"))[:5]
        holds = f"; it holds {', '.join(others)}: name the folder like the model" if others else ""
        raise InputError(
            f"{path.parent} is no aircraft's folder: no {path.name} (folder NAME holds a model, NAME.xml, "
            f"and perhaps aircraft.toml){holds}"
        )
    included, reaching_out = _checked(path)
    for name in included:
        if {"/", ".."}.intersection(PurePosixPath(name.replace("\\", "/")).parts):
            raise InputError(f"{path} includes '{name}'; a model's parts stand in its own folder")
        part = path.parent / name
        part = part if part.suffix == ".xml" else Path(f"{part}.xml")
        if part.exists():
            if not is_file(part):
                raise InputError(f"{path} includes {part}, which isn't a file")
            if sections := _checked(part)[1]:
                raise InputError(f"{part}, which {path.name} includes, has an <{sections[0]}> section; take it out")
    return reaching_out


@contextmanager
def loadable(path: Path, *, without_io: bool) -> Iterator[Path]:
    """Give a model's file as JSBSim may load it: itself, or for a while a copy without input and output sections."""
    reaching_out = check_model(path)
    if not reaching_out:
        yield path
        return
    if not without_io:
        raise InputError(
            f"{path} has an <{reaching_out[0]}> section, which would reach outside (files, ports); take it out, or "
            "leave such sections out: --without-io, or without_io = true in its aircraft.toml"
        )
    with tempfile.TemporaryDirectory() as aside:
        folder = Path(aside) / "aircraft" / path.parent.name
        for part in (*path.parent.glob("*.xml"), *path.parent.glob("*/*.xml")):  # Engines/, Systems/
            if is_file(part):
                copy = folder / part.relative_to(path.parent)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(part, copy)
        tree = ET.parse(path)  # noqa: S314  there are no entities in it: checked
        root = tree.getroot()
        for section in [element for element in root if element.tag in _REACH_OUT]:
            root.remove(section)
        tree.write(folder / path.name, encoding="utf-8")
        yield folder / path.name


def description(path: Path) -> str:
    """Return what a checked model says that it is, in one line; "" where it says nothing."""
    said = ET.parse(path).getroot().findtext("fileheader/description") or ""  # noqa: S314  as above
    return " ".join(said.split())


def _checked(path: Path) -> tuple[list[str], tuple[str, ...]]:
    """Return the names of the files that a file includes, and its sections that reach outside."""
    open_elements: list[str] = []
    included: list[str] = []
    reaching_out: list[str] = []

    def begin(name: str, attributes: dict[str, str]) -> None:
        if len(open_elements) == 1 and name in _REACH_OUT:
            reaching_out.append(name)
        elif "file" in attributes and not set(reaching_out).intersection(open_elements[1:2]):
            included.append(attributes["file"])
        open_elements.append(name)
        if len(open_elements) > _DEEPEST:
            raise InputError(f"{path} has elements in elements, more than {_DEEPEST} deep; no model needs that")

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
    return included, tuple(reaching_out)
