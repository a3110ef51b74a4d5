"""The lines of code of each room of the package, counted: `python -m tests.project.budget` prints `budget.toml` anew.

A line of code is a physical line that holds code. Docstrings, comments, blank lines and imports don't count, so nobody
saves on them; a string over several lines counts with all of its lines that aren't blank.
"""

import ast
from collections import Counter
from pathlib import Path
from typing import TypeGuard

PACKAGE = Path(__file__).parents[2] / "gtmbench"


def code_lines(source: str) -> int:
    """Return how many physical lines of a source hold code.

    >>> code_lines('import os  # a module' + chr(10) + 'x = 1  # a line' + chr(10) + chr(10) + '# a comment')
    1
    """
    kept = [line.encode() for line in source.splitlines()]  # places of statements are in bytes
    in_text: set[int] = set()  # lines within a string, where # begins no comment
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom) or _is_text(node):
            _blank(kept, node)
        elif isinstance(node, ast.JoinedStr | ast.Constant) and node.end_lineno and node.end_lineno > node.lineno:
            in_text |= set(range(node.lineno + 1, node.end_lineno + 1))
    code = [line.strip(b" ;\t") for line in kept]
    return sum(bool(line) and (number in in_text or line[:1] != b"#") for number, line in enumerate(code, 1))


def _blank(lines: list[bytes], node: ast.stmt) -> None:
    """Take a statement out of its lines."""
    last = node.end_lineno or node.lineno
    for number in range(node.lineno, last + 1):
        line = lines[number - 1]
        since = node.col_offset if number == node.lineno else 0
        until = node.end_col_offset if number == last else len(line)
        lines[number - 1] = line[:since] + line[until:]


def _is_text(node: ast.AST) -> TypeGuard[ast.Expr]:
    """Tell whether a statement is only a text: a docstring, also that of an attribute."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def measured(package: Path = PACKAGE) -> dict[str, int]:
    """Return the lines of code of each folder that holds code, by its path; "." is the package's own."""
    rooms: Counter[str] = Counter()
    for module in sorted(package.rglob("*.py")):
        room = module.parent.relative_to(package).as_posix()
        rooms[room] += code_lines(module.read_text(encoding="utf-8"))
    return {room: lines for room, lines in sorted(rooms.items()) if lines}


def as_toml(rooms: dict[str, int]) -> str:
    """Return the figures as a table in TOML."""
    head = (
        "# Lines of code that each room of the package may have; docstrings, comments and imports don't count.\n"
        "# Whoever needs more raises a figure and writes the reason beside it. Measured anew by\n"
        "# python -m tests.project.budget > tests/project/budget.toml\n\n[rooms]\n"
    )
    return head + "".join(f'"{room}" = {lines}\n' for room, lines in rooms.items())


if __name__ == "__main__":
    rooms = measured()
    print(as_toml(rooms) + f"\n# in all {sum(rooms.values()):,}")
