"""The lines of code of each room of the package, counted: `python -m tests.project.budget` prints `budget.toml` anew.

A line of code is a physical line that holds code. Docstrings, comments, blank lines and imports don't count, so nobody
saves on them; a string over several lines counts with all of its lines that aren't blank.
"""

import ast
import io
import tokenize
from collections import Counter
from pathlib import Path
from typing import TypeGuard

PACKAGE = Path(__file__).parents[2] / "gtmbench"
Place = tuple[int, int]  # a line, and how many bytes into it
_NO_CODE = {
    tokenize.ENCODING,
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}


def code_lines(source: str) -> int:
    """Return how many physical lines of a source hold code.

    >>> code_lines('import os  # a module' + chr(10) + 'x = 1  # a line' + chr(10) + chr(10) + '# a comment')
    1
    """
    lines = source.splitlines()
    uncounted = _docstrings_and_imports(ast.parse(source))
    held: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        spans = uncounted.get(token.start[0], ())
        if token.type in _NO_CODE or token.string == ";" or any(first <= token.start < end for first, end in spans):
            continue
        held |= {number for number in range(token.start[0], token.end[0] + 1) if lines[number - 1].strip()}
    return len(held)


def _docstrings_and_imports(tree: ast.AST) -> dict[int, list[tuple[Place, Place]]]:
    """Return, by line, where the statements begin and end that don't count."""
    by_line: dict[int, list[tuple[Place, Place]]] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom) or _is_text(node):
            first, last = node.lineno, node.end_lineno or node.lineno
            span = (first, node.col_offset), (last, node.end_col_offset or 0)
            for number in range(first, last + 1):
                by_line.setdefault(number, []).append(span)
    return by_line


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
