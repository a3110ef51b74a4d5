"""A check as JUnit XML, which CI systems show: a test case for every group of figures, so for every trial."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from gtmbench.check.run import Check
from gtmbench.check.words import regression_line
from gtmbench.files import atomic_write


def write_junit(found: Check, path: Path, *, took_s: float) -> None:
    """Write a check as a JUnit file; `took_s`: how long the run took."""
    failed: dict[str, list[str]] = {}
    for one in found.regressions:
        failed.setdefault(one.group, []).append(regression_line(one))
    name = f"gtmbench check {found.reference.path.stem}"
    counts = {"tests": str(len(found.groups)), "failures": str(len(failed)), "errors": "0", "time": f"{took_s:.3f}"}
    suites = ET.Element("testsuites", {"name": "gtmbench check", **counts})
    suite = ET.SubElement(suites, "testsuite", {"name": _printable(name), "skipped": "0", **counts})
    for group in found.groups:
        names = {
            "classname": _printable(f"gtmbench.check.{found.reference.path.stem}"),
            "name": _printable(group.title),
        }
        case = ET.SubElement(suite, "testcase", {**names, "time": "0"})
        lines = [_printable(line) for line in failed.get(group.title, [])]
        if lines:
            ET.SubElement(case, "failure", {"message": lines[0], "type": "regression"}).text = "\n".join(lines)
    ET.indent(suites)
    suites.tail = "\n"
    with atomic_write(path) as aside:
        ET.ElementTree(suites).write(aside, encoding="utf-8", xml_declaration=True)


def _printable(text: str) -> str:
    """Return a text without what XML can't hold: a file's name may have control characters."""
    return "".join(character if character.isprintable() else "?" for character in text)
