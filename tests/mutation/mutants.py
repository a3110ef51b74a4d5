"""Mutants of a source: the same text with one comparison, operation, number, condition or choice another."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

COMPARISONS = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "is not": "is", "is": "is not"}
COMPARISONS |= {"not in": "in", "in": "not in"}
OPERATIONS = {"+": "-", "-": "+", "*": "/", "/": "*", "//": "/", "**": "*", "%": "*", "&": "|", "|": "&"}
BETWEEN = {"and": "or", "or": "and"}
CHOICES = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum"}
CHOICES |= {"floor": "ceil", "ceil": "floor", "sin": "cos", "cos": "sin", "nanmin": "nanmax", "nanmax": "nanmin"}
CHOICES |= {"argmin": "argmax", "argmax": "argmin", "hstack": "vstack", "vstack": "hstack", "mean": "median"}
SILENT = (ast.Raise, ast.JoinedStr, ast.Import, ast.ImportFrom)
"""In what nothing is changed: messages and imports."""
DECLARED = {"repr", "strict", "frozen", "kw_only", "eq", "init", "compare", "slots", "check", "maxsize", "stacklevel"}
DECLARED |= {"shown"}
"""Keywords that say how something is declared, or how large a picture shows it: no reading or verdict depends on it."""


Place = tuple[int, int, str]


@dataclass(frozen=True)
class Mutant:
    """One change of a file: the text between two places is another."""

    file: str
    line: int
    begin: int
    end: int
    before: str
    after: str
    names: tuple[str, ...]
    """What a module or a class knows the line by, where it isn't in a function: its constants."""
    function: str

    def applied(self, source: str) -> str:
        """Return the file's text with the change."""
        return source[: self.begin] + self.after + source[self.end :]

    def __str__(self) -> str:
        return f"{self.file}:{self.line} {self.function}: {self.before} -> {self.after}"


def mutants(file: str, source: str) -> list[Mutant]:
    """Return every mutant of a file, in the order of its text."""
    found = list(_Seeker(file, source).of_module())
    return sorted(found, key=lambda each: (each.begin, each.after))


class _Seeker:
    """Goes through a file's tree and knows where in the text its nodes are."""

    def __init__(self, file: str, source: str) -> None:
        self.file, self.source = file, source
        starts = [0]
        for line in source.splitlines(keepends=True):
            starts.append(starts[-1] + len(line.encode()))
        self.starts = starts
        self.bytes = source.encode()

    def of_module(self) -> Iterator[Mutant]:
        yield from self._of_block(ast.parse(self.source).body, "", ())

    def _of_block(self, body: list[ast.stmt], function: str, names: tuple[str, ...]) -> Iterator[Mutant]:
        for each in body:
            if isinstance(each, ast.FunctionDef):
                within = f"{function}.{each.name}".lstrip(".")
                for default in (*each.args.defaults, *each.args.kw_defaults):
                    if default is not None:
                        known = function.rpartition(".")[2] if each.name == "__init__" else each.name
                        yield from self._of_node(default, within, (known,))
                yield from self._of_block(each.body, within, ())
            elif isinstance(each, ast.ClassDef):
                yield from self._of_block(each.body, f"{function}.{each.name}".lstrip("."), (each.name,))
            else:
                yield from self._of_statement(each, function, names)

    def _of_statement(self, node: ast.stmt, function: str, names: tuple[str, ...]) -> Iterator[Mutant]:
        """At the top of a module and of a class, what a line declares is known by its name."""
        if function and not names:
            yield from self._of_node(node, function, ())
        elif (
            isinstance(node, ast.Assign)
            and isinstance(node.targets[0], ast.Tuple)
            and isinstance(node.value, ast.Tuple)
        ):
            for target, value in zip(node.targets[0].elts, node.value.elts, strict=True):
                yield from self._of_node(value, function, (*names, ast.unparse(target)))
        else:
            target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
            declared = () if target is None else (ast.unparse(target),)
            yield from self._of_node(node, function, (*names, *declared))

    def _of_node(self, node: ast.AST, function: str, names: tuple[str, ...]) -> Iterator[Mutant]:
        if isinstance(node, ast.AnnAssign):
            if node.value is not None:
                yield from self._of_node(node.value, function, names)
            return
        if isinstance(node, SILENT) or (isinstance(node, ast.Constant) and isinstance(node.value, str)):
            return
        if (isinstance(node, ast.Call) and _is_spoken(node)) or (
            isinstance(node, ast.keyword) and node.arg in DECLARED
        ):
            return
        yield from self._changes(node, function, names)
        for child in ast.iter_child_nodes(node):
            yield from self._of_node(child, function, names)

    def _changes(self, node: ast.AST, function: str, names: tuple[str, ...]) -> Iterator[Mutant]:
        for begin, end, after in (*self._operators(node), *self._values(node)):
            before = self.bytes[begin:end].decode()
            first, last = (len(self.bytes[:place].decode()) for place in (begin, end))  # characters from here on
            yield Mutant(self.file, node.lineno, first, last, before, after, names, function)

    def _operators(self, node: ast.AST) -> Iterator[Place]:
        """Yield what of a node becomes what: from and to which byte, and the other text."""
        match node:
            case ast.Compare():
                for left, right in pairwise([node.left, *node.comparators]):
                    yield from self._between(left, right, COMPARISONS)
            case ast.BinOp() if not _is_text(node.left) and not _is_text(node.right):
                yield from self._between(node.left, node.right, OPERATIONS)
            case ast.BoolOp():
                for left, right in pairwise(node.values):
                    yield from self._between(left, right, BETWEEN)
            case ast.AugAssign():
                yield from self._between(node.target, node.value, {f"{a}=": f"{b}=" for a, b in OPERATIONS.items()})
            case ast.UnaryOp(op=ast.Not()):
                yield self._begin(node), self._begin(node) + len("not"), ""
            case ast.UnaryOp(op=ast.USub()):
                yield self._begin(node), self._begin(node) + len("-"), ""

    def _values(self, node: ast.AST) -> Iterator[Place]:
        """Yield the same of numbers, conditions, functions that are chosen, and ways out of loops."""
        match node:
            case ast.Constant(value=bool() | int() | float()):
                yield self._begin(node), self._end(node), _another(node.value)
            case ast.If() | ast.IfExp() | ast.While() if isinstance(node.test, ast.Name | ast.Attribute | ast.Call):
                begin, end = self._begin(node.test), self._end(node.test)
                yield begin, end, f"(not {self.bytes[begin:end].decode()})"
            case ast.Name(id=called, ctx=ast.Load()) | ast.Attribute(attr=called, ctx=ast.Load()) if called in CHOICES:
                yield self._end(node) - len(called), self._end(node), CHOICES[called]
            case ast.Continue() | ast.Break():
                yield self._begin(node), self._end(node), "break" if isinstance(node, ast.Continue) else "continue"

    def _between(self, left: ast.expr, right: ast.expr, others: dict[str, str]) -> Iterator[Place]:
        """Change the operator that stands between two expressions, whatever brackets and blanks are around it."""
        begin, end = self._end(left), self._begin(right)
        text = self.bytes[begin:end].decode()
        bare = text.strip("() \n\t")
        if bare in others:
            at = begin + len(text[: text.index(bare)].encode())
            yield at, at + len(bare), others[bare]

    def _begin(self, node: ast.AST) -> int:
        return self.starts[node.lineno - 1] + node.col_offset

    def _end(self, node: ast.AST) -> int:
        return self.starts[node.end_lineno - 1] + node.end_col_offset


def _another(value: float) -> str:
    """Return another number: off by one, or by three tenths; the other truth."""
    if isinstance(value, bool):
        return str(not value)
    return str(value + 1) if isinstance(value, int) else f"{1.3 * value if value else 1.0:#.6g}"


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def _is_spoken(call: ast.Call) -> bool:
    """Return whether a call makes an error, whose message isn't looked at."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    return name.endswith(("Error", "Warning")) or name in {"warn", "TypeVar", "NewType"}
