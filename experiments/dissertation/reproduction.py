"""What every script of `experiments/` does alike: ours beside the printed results, figures, an exit code."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import click
import numpy as np
from numpy.typing import ArrayLike

from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files.folders import atomic_folder, check_folder
from gtmbench.files.plain import dumps, finite_or_none, plain
from gtmbench.files.shipped import code_facts
from theory.polynomials import read_polynomial, write_polynomial
from theory.rational import Coefficients, PolynomialMatrix, entries

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Agreement = Literal["agrees", "differs", "not printed"]
_DPI = 100
_MOST = 3  # polynomials in a cell; more are cut short, `values` has them all
RESULTS = "results.json"
LIBRARIES = ("numpy", "scipy", "sympy", "cvxpy", "jsbsim")  # their versions are kept with what they computed


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
        "agrees" or "differs" where the source has a figure or a sentence, whoever is right; else "not printed".
    expected : bool
        Whether the row came out as its script says: a difference has its reason there, or fails.
    note : str
        What a reader must know: why it differs, what was assumed for a missing parameter, what was chosen after trying.
    runs : int or None
        How many random cases it stands on, where ``--quick`` takes fewer; else None.
    values : object
        Ours with every digit, as JSON has it; nothing that rounding alone decides.
    """

    result: str
    printed: str
    ours: str
    agreement: Agreement
    expected: bool
    note: str
    runs: int | None
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

    def number(
        self, result: str, printed: ArrayLike, ours: ArrayLike, *, tolerance: float, differs: str = "", note: str = ""
    ) -> None:
        """Hold a number, or an array of them, against the printed ones: nowhere further off than `tolerance`.

        Half a unit of the last printed digit is what a print can promise. `differs` is as in `claim`.
        """
        theirs, mine = np.asarray(printed, dtype=float), np.asarray(ours, dtype=float)
        agrees = theirs.shape == mine.shape and bool(np.all(np.abs(theirs - mine) <= tolerance))
        wanted = f"{_written(theirs, 'g')} ± {tolerance:g}"
        self.claim(result, wanted, _written(mine, ".7g"), agrees=agrees, differs=differs, note=note, values=mine)

    def claim(
        self,
        result: str,
        printed: str,
        ours: str,
        *,
        agrees: bool,
        differs: str = "",
        holds: bool = True,
        note: str = "",
        runs: int | None = None,
        values: object = None,
    ) -> None:
        """Hold what a figure or a sentence says against ours.

        Parameters
        ----------
        agrees : bool
            Whether ours is what is printed, as computed.
        differs : str
            Why ours is known to differ; a row that differs without it, or agrees in spite of it, isn't expected.
        holds : bool
            Whether what the row says of ours beyond that is so.
        runs : int, optional
            How many random cases it stands on, where ``--quick`` takes fewer.
        values : object
            The figures behind it, with every digit, but for what rounding alone decides.
        """
        word: Agreement = "agrees" if agrees else "differs"
        expected = bool(agrees) is not bool(differs) and bool(holds)
        said = "; ".join(filter(None, (differs, note)))
        self._keep(result, printed, ours, agreement=word, expected=expected, note=said, runs=runs, values=values)

    def unprinted(
        self,
        result: str,
        ours: str,
        *,
        holds: bool = True,
        note: str = "",
        runs: int | None = None,
        values: object = None,
    ) -> None:
        """State a result that the source doesn't print; what the row says of it, `holds` or not."""
        self._keep(result, "", ours, agreement="not printed", expected=bool(holds), note=note, runs=runs, values=values)

    def draw(self, name: str, figure: Figure) -> None:
        """Save a figure as NAME.png."""
        figure.savefig(self.folder / f"{name}.png", dpi=_DPI)
        self.figures.append(f"{name}.png")

    def _keep(self, result: str, printed: str, ours: str, *, values: object, **said: Any) -> None:
        row = Row(result=result, printed=printed, ours=ours, values=plain(values, _number_or_words), **said)
        self.rows.append(row)
        if not self.silent:
            word = row.agreement + ("" if row.expected else ", NOT AS EXPECTED")
            click.echo(f"{result:<44} {printed:>28} {ours:>32}   {word}{f' ({row.note})' if row.note else ''}")


def tally(words: Iterable[str]) -> str:
    """Return how many rows say what.

    >>> tally(["agrees", "not printed", "agrees"])
    '2 agree, 0 differ, 1 not printed'
    """
    agree, differ, bare = map(list(words).count, get_args(Agreement))
    return f"{agree} agree, {differ} differ, {bare} not printed"


def reproduce(steps: Callable[[Reproduction], None], script: str, description: str | None) -> int:
    """Run a script's steps with ``--quick``, ``--out`` and ``--json``; return 1 where a row isn't as expected, else 0.

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
    try:
        _make_parents(given.out)
        check_folder(given.out, force=True)
        with atomic_folder(given.out) as folder:
            page = Reproduction(quick=given.quick, folder=folder, silent=given.json)
            steps(page)
            results = {
                "script": f"{name}.py",
                "command": f"python experiments/{name}.py{' --quick' if page.quick else ''}",
                "code": code_facts(LIBRARIES),
                "quick": page.quick,
                "figures": page.figures,
                "rows": [asdict(row) for row in page.rows],
            }
            written = dumps(results, indent=1)
            (folder / RESULTS).write_text(written + "\n", encoding="utf-8")
    except GtmbenchError as error:
        click.echo(f"{name}.py: {error}", err=True)
        return 2
    if given.json:
        click.echo(written)
    else:
        said = tally(row.agreement for row in page.rows)
        click.echo(f"{said}; {len(page.figures)} figures and {RESULTS} in {given.out}")
    wrong = [row for row in page.rows if not row.expected]
    for row in wrong:
        click.echo(
            f"{name}.py: {row.result}: {row.ours}, where {row.printed or 'something else'} is expected", err=True
        )
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


def claim_equal(page: Reproduction, result: str, equal: bool) -> None:
    """Hold what the source calls equal against whether it is, exactly."""
    page.claim(result, "equal", "equal, exactly" if equal else "not equal", agrees=equal)


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
