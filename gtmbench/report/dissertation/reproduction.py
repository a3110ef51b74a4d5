"""What every script of `experiments/` does alike: ours beside the printed results, figures, an exit code."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
import numpy as np
from numpy.typing import ArrayLike

from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files import atomic_folder, check_folder
from gtmbench.plain import dumps, finite_or_none, plain
from gtmbench.theory.polynomials import read_polynomial, write_polynomial
from gtmbench.theory.rational import Coefficients, PolynomialMatrix, entries

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Agreement = Literal["agrees", "DISAGREES", "not printed"]
_DPI = 100
_MOST = 3  # polynomials in a cell; more are cut short, `values` has them all
RESULTS = "results.json"


@dataclass(frozen=True, kw_only=True)
class Row:
    """One printed result or figure, and what came out.

    Attributes
    ----------
    result : str
        Where it stands and what it is: ``Ex. 3.1, rho_s``.
    printed, ours : str
        As a reader compares them.
    agreement : str
        "agrees", "DISAGREES", or "not printed" where the source has no figure.
    note : str
        What a reader must know: that the source has a misprint, what was assumed for a missing parameter.
    seconds : float
        Time since the row before.
    values : object
        Ours with every digit, as JSON has it.
    """

    result: str
    printed: str
    ours: str
    agreement: Agreement
    note: str
    seconds: float
    values: Any


@dataclass(kw_only=True)
class Reproduction:
    """Collects the rows and the figures of one script; `reproduce` makes it.

    Attributes
    ----------
    quick : bool
        Whether seconds are to do: fewer realisations, the same claims.
    folder : Path
        Where figures go, through `draw`.
    rows : list of Row
    """

    quick: bool
    folder: Path
    silent: bool = False
    rows: list[Row] = field(default_factory=list)
    figures: list[str] = field(default_factory=list)
    _last: float = field(default_factory=time.perf_counter)

    def number(self, result: str, printed: ArrayLike, ours: ArrayLike, *, tolerance: float, note: str = "") -> None:
        """Hold a number, or an array of them, against the printed ones: nowhere further off than `tolerance`.

        Half a unit of the last printed digit is what a print can promise.
        """
        theirs, mine = np.asarray(printed, dtype=float), np.asarray(ours, dtype=float)
        agrees = theirs.shape == mine.shape and bool(np.all(np.abs(theirs - mine) <= tolerance))
        wanted = f"{_written(theirs, 'g')} ± {tolerance:g}"
        self.claim(result, wanted, _written(mine, ".7g"), agrees=agrees, note=note, values=mine)

    def claim(
        self, result: str, printed: str, ours: str, *, agrees: bool, note: str = "", values: object = None
    ) -> None:
        """Hold what a figure or a sentence says against ours; `values` are the figures behind it, with every digit."""
        self._add(result, printed, ours, "agrees" if agrees else "DISAGREES", note, values)

    def unprinted(self, result: str, ours: str, *, note: str = "", values: object = None) -> None:
        """State a result that the source doesn't print."""
        self._add(result, "", ours, "not printed", note, values)

    def draw(self, name: str, figure: Figure) -> None:
        """Save a figure as NAME.png."""
        figure.savefig(self.folder / f"{name}.png", dpi=_DPI)
        self.figures.append(f"{name}.png")

    def _add(self, result: str, printed: str, ours: str, agreement: Agreement, note: str, values: object) -> None:
        now = time.perf_counter()
        row = Row(
            result=result,
            printed=printed,
            ours=ours,
            agreement=agreement,
            note=note,
            seconds=now - self._last,
            values=plain(values, _number_or_words),
        )
        self._last = now
        self.rows.append(row)
        if not self.silent:
            click.echo(f"{result:<44} {printed:>28} {ours:>32}   {agreement}{f' ({note})' if note else ''}")


def reproduce(steps: Callable[[Reproduction], None], script: str, description: str | None) -> int:
    """Run a script's steps with ``--quick``, ``--out`` and ``--json``; return 1 where a row disagrees, else 0.

    Figures and ``results.json`` appear in the folder together, at the end. Bad input: one line, 2.
    """
    name = Path(script).stem
    parser = argparse.ArgumentParser(
        prog=f"{name}.py", description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="seconds: fewer realisations, the same claims")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/experiments") / name,
        metavar="DIR",
        help="folder of the figures and results.json, made if it isn't there (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print results.json instead of the rows")
    given = parser.parse_args()
    started = time.perf_counter()
    try:
        _make_parents(given.out)
        check_folder(given.out, force=True)
        with atomic_folder(given.out) as folder:
            page = Reproduction(quick=given.quick, folder=folder, silent=given.json)
            steps(page)
            results = {
                "script": f"{name}.py",
                "quick": page.quick,
                "seconds": time.perf_counter() - started,
                "figures": page.figures,
                "rows": [asdict(row) for row in page.rows],
            }
            written = dumps(results, indent=1)
            (folder / RESULTS).write_text(written + "\n", encoding="utf-8")
    except GtmbenchError as error:
        click.echo(f"{name}.py: {error}", err=True)
        return 2
    wrong = sum(row.agreement == "DISAGREES" for row in page.rows)
    if given.json:
        click.echo(written)
    else:
        held = sum(row.agreement != "not printed" for row in page.rows)
        click.echo(f"{held - wrong} of {held} agree; {len(page.figures)} figures and {RESULTS} in {given.out}")
    return 1 if wrong else 0


def claim_polynomials(
    page: Reproduction,
    result: str,
    printed: Sequence[str],
    ours: Sequence[Coefficients],
    *,
    expected: Sequence[Coefficients] | None = None,
    note: str = "",
) -> None:
    """Hold polynomials against the printed ones, coefficient by coefficient, exactly.

    `expected` are the printed ones' coefficients by falling powers, where `read_polynomial` can't read the print.
    """
    theirs = [read_polynomial(text) for text in printed] if expected is None else expected
    agrees = len(theirs) == len(ours) and all(map(_is_same, theirs, ours))
    written = [write_polynomial(polynomial) for polynomial in ours]
    page.claim(result, _cell(printed), _cell(written), agrees=agrees, note=note, values=ours)


def flat(matrix: PolynomialMatrix) -> list[Coefficients]:
    """Return the coefficients of all entries of a polynomial matrix, row by row."""
    return [entry for row in entries(matrix) for entry in row]


def listed(values: ArrayLike) -> str:
    """Return numbers as a cell has them, with 7 digits.

    >>> listed([0.5, 1.0 / 3.0])
    '0.5 0.3333333'
    """
    return " ".join(f"{x:.7g}" for x in np.ravel(values))


def _make_parents(out: Path) -> None:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"can't make the folder {out.parent}: {error.strerror}; give another --out") from error


def _is_same(theirs: Coefficients, ours: Coefficients) -> bool:
    from sympy import cancel, sympify

    return len(theirs) == len(ours) and all(
        cancel(sympify(a) - sympify(b)) == 0 for a, b in zip(theirs, ours, strict=True)
    )


def _cell(texts: Sequence[str]) -> str:
    return "; ".join(texts if len(texts) <= _MOST else [*texts[: _MOST - 1], "...", texts[-1]])


def _written(values: np.ndarray[Any, Any], form: str) -> str:
    cells = [f"{x:{form}}" for x in values.ravel()]
    return " ".join(cells if len(cells) <= 8 else [*cells[:4], "...", *cells[-2:]])


def _number_or_words(value: object) -> object:
    """Return a leaf with nothing lost: complex numbers as [real, imaginary], NaN, infinities and symbols as words."""
    if isinstance(value, Fraction):
        return value.numerator if value.denominator == 1 else float(value)
    if isinstance(value, complex):
        return [value.real, value.imag]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else finite_or_none(value)
