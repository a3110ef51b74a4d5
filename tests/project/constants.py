"""Which numbers a reader may doubt: `python -m tests.project.constants [--without]` counts every room's constants.

A constant is a name in capitals at the head of a module, or of a class, whose value holds a number that isn't an index.
It is explained where a comment stands beside it, above it or above the group that it heads, and it is backed where that
comment names a source, a script that measured it, or over which values nothing changes. `--without` lists those that
nothing explains.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.project.budget import PACKAGE

_NAME = re.compile(r"_{0,2}[A-Z][A-Z0-9_]*$")
BACKED = re.compile(
    r"\b(?:experiments|tests)/\w|chosen; from|\bmeasured|\b(?:19|20)\d\d\b|\bTable \d|\b(?:equation|eq\.) ?\(|"
    r"\b(?:theory|Gaussian|normal distribution|by definition|documents?|ArduPilot|PX4|MAVLink|JSBSim|WGS)\b"
)


class Constant(NamedTuple):
    """A constant, and what is said of it."""

    path: Path
    line: int
    name: str
    comment: str

    @property
    def room(self) -> str:
        """The folder of the package that it stands in."""
        return self.path.parent.relative_to(PACKAGE).as_posix()


def constants_of(source: str, path: Path = Path()) -> Iterator[Constant]:
    """Give the numeric constants of a module."""
    tree, lines = ast.parse(source), source.splitlines()
    bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
    for node in (each for body in bodies for each in body):
        if isinstance(node, ast.Assign):
            targets, value = node.targets, node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            targets, value = [node.target], node.value
        else:
            continue
        if any(_is_number(each) for each in ast.walk(value)):
            names = [each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)]
            comment = _comment(lines, node.lineno, node.end_lineno or node.lineno)
            yield from (Constant(path, node.lineno, name, comment) for name in names if _NAME.match(name))


def _is_number(node: ast.AST) -> bool:
    """Tell whether a node is a number that isn't an index: 0, 1, 2 and -1 are."""
    is_number = isinstance(node, ast.Constant) and type(node.value) in (int, float)
    return is_number and not (type(node.value) is int and node.value in (0, 1, 2))


def _comment(lines: list[str], first: int, last: int) -> str:
    """Return the comments in and behind a statement's lines, or those above it."""
    beside = [line.partition("#")[2].strip() for line in lines[first - 1 : last] if "#" in line]
    at = first - 2
    while at >= 0 and lines[at].lstrip().startswith("#"):
        beside.insert(0, lines[at].strip().lstrip("# "))
        at -= 1
    return " ".join(beside)


def measured() -> list[Constant]:
    """Return the constants of the package."""
    files = sorted(PACKAGE.rglob("*.py"))
    return [each for path in files for each in constants_of(path.read_text(encoding="utf-8"), path)]


def main() -> None:
    """Print how many constants each room has, how many of them are explained, and how many backed."""
    found = measured()
    if "--without" in sys.argv:
        bare = (each for each in found if not each.comment)
        print("\n".join(f"{each.path.relative_to(PACKAGE.parent)}:{each.line} {each.name}" for each in bare))
        return
    counts = {
        "constants": Counter(each.room for each in found),
        "explained": Counter(each.room for each in found if each.comment),
        "backed": Counter(each.room for each in found if BACKED.search(each.comment)),
    }
    print(f"{'room':<32}" + "".join(f"{what:>11}" for what in counts))
    for room in sorted(counts["constants"]):
        print(f"{room:<32}" + "".join(f"{of[room]:>11}" for of in counts.values()))
    print(f"{'in all':<32}" + "".join(f"{of.total():>11}" for of in counts.values()))


if __name__ == "__main__":
    main()
