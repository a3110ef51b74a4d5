"""Tables whose rows, stamps and columns are in disorder: what damaged bytes hardly ever make of a flight."""

import random

ABSURD = ("1e30", "-1e30", "nan", "inf", "", "0", "x", "1e-320", "9007199254740993", "2026-11-30")
# a pause of hours costs what a flight does (docs/reference/nightly.md)
JUMPS_S = (1e-9, 0.05, 1.0, 60.0, 4000.0, 2.0**53)


def disordered(table: bytes, seed: str) -> bytes:
    """Return a table, its time in the first column, that is in disorder somewhere."""
    draw = random.Random(seed)
    head, *rows = [line.split(",") for line in table.decode().splitlines()]
    for _ in range(draw.choice([1, 1, 2, 4])):
        since = draw.randrange(len(rows))
        part = rows[since : since + draw.choice([1, 2, 10, 100, len(rows)])]
        rows = [*rows[:since], *draw.choice(WAYS)(part, draw), *rows[since + len(part) :]] or rows
    return "\n".join(map(",".join, [head, *rows])).encode() + b"\n"


def number(cell):
    try:
        return float(cell)
    except ValueError:
        return 0.0


def changed(rows, column, change):
    """Return rows with a column of other numbers."""
    return [[*row[:column], repr(change(number(row[column]))), *row[column + 1 :]] for row in rows]


def repeated(rows, _):
    return [*rows, *rows]


def lost(*_):
    return []


def shuffled(rows, draw):
    return draw.sample(rows, len(rows))


def late(rows, draw):
    by_s = draw.choice(JUMPS_S) * draw.choice([-1, 1])
    return changed(rows, 0, lambda time_s: time_s + by_s)


def at_another_rate(rows, draw):
    begin_s, by = number(rows[0][0]), draw.choice([0.0, 1e-12, 0.1, 10.0, 1e6])
    return changed(rows, 0, lambda time_s: begin_s + by * (time_s - begin_s))


def absurd(rows, draw):
    column, value = draw.randrange(len(rows[0])), draw.choice(ABSURD)
    return [[*row[:column], value, *row[column + 1 :]] for row in rows]


def scaled(rows, draw):
    by = draw.choice([0.0, 1e-9, 57.3, -1.0, 1e6])
    return changed(rows, draw.randrange(len(rows[0])), lambda value: by * value)


def swapped(rows, draw):
    order = draw.sample(range(len(rows[0])), len(rows[0]))
    return [[row[column] for column in order] for row in rows]


def thinned(rows, draw):
    return rows[:: draw.choice([2, 5, 50])]


WAYS = (repeated, lost, shuffled, late, at_another_rate, absurd, scaled, swapped, thinned)
