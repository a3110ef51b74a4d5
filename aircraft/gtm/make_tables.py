"""Write the tables of gtm-tables.xml from NASA's aerodynamic database of the GTM-T2.

The database is the file ``T2_polynomial_aerodatabase.mat`` of NASA GTM_DesignSim (LAR-17625-1); it is
not part of this repository. One run of ``python make_tables.py T2_polynomial_aerodatabase.mat`` made
the tables beside this script; README.md says what they mean. Nothing else in the project needs this file.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

SIX = ["CX", "CY", "CZ", "Cl", "Cm", "Cn"]
LONGITUDINAL = ["CX", "CZ", "Cm"]
LATERAL = ["CY", "Cl", "Cn"]

# Left surfaces and positive rudders are mirrored: looked up at -beta.
ALPHA, BETA, MIRRORED = "aero/alpha-deg", "aero/beta-deg", "aero/beta-mirrored-deg"
HERE = Path(__file__).parent
MARK = "<!-- The tables, angles in degrees, interpolated linearly, ends held: make_tables.py writes what follows -->\n"


def number(value: float) -> str:
    """Six decimals (1e-6 of a coefficient), without trailing zeros."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


def rows(values: np.ndarray, row_keys: np.ndarray, column_keys: np.ndarray) -> list[str]:
    """One two-dimensional table in JSBSim's layout: column keys, then a row key and its values."""
    lines = ["      " + " ".join(number(key) for key in column_keys)]
    lines += [
        f"{number(key)} " + " ".join(number(value) for value in line)
        for key, line in zip(row_keys, values, strict=True)
    ]
    return lines


def function(name: str, keys: list[str], axes: list[np.ndarray], values: np.ndarray) -> list[str]:
    """Write one table as a JSBSim function; a third axis becomes one tableData per break point."""
    lines = [f'<function name="aero/{name}"><table>']
    for key, lookup in zip(keys, ["row", "column", "table"], strict=False):
        lines.append(f'<independentVar lookup="{lookup}">{key}</independentVar>')
    if values.ndim == 2:
        lines += ["<tableData>", *rows(values, *axes), "</tableData>"]
    else:
        for index, point in enumerate(axes[2]):
            lines += [f'<tableData breakPoint="{number(point)}">', *rows(values[:, :, index], *axes[:2])]
            lines.append("</tableData>")
    return [*lines, "</table></function>", ""]


def tables(database: dict) -> list[str]:
    """All tables that the undamaged airframe with gear, flaps and spoilers retracted needs."""
    bas, ele, ail, rud = (database[name] for name in ("C6_bas", "dC3_ele", "dC6_ail", "dC6_rud"))
    lines: list[str] = []
    for i, c in enumerate(SIX):
        lines += function(f"bare/{c}", [ALPHA, BETA], [bas.alpha, bas.beta], bas.data[:, :, i])
    level = int(np.flatnonzero(ele.stab == 0)[0])
    for i, c in enumerate(LONGITUDINAL):
        keys = [ALPHA, BETA, "fcs/elevator-pos-deg"]
        lines += function(f"elevator/{c}", keys, [ele.alpha, ele.beta, ele.elev], ele.data[:, :, level, :, i])
    for side, beta in (("right", BETA), ("left", MIRRORED)):
        for i, c in enumerate(SIX):
            keys = [ALPHA, beta, f"fcs/{side}-aileron-pos-deg"]
            lines += function(f"{side}-aileron/{c}", keys, [ail.alpha, ail.beta, ail.ail], ail.data[..., i])
    for i, c in enumerate(SIX):
        keys = [ALPHA, "aero/rudder-lookup-beta-deg", "aero/rudder-lookup-deg"]
        lines += function(f"rudder/{c}", keys, [rud.alpha, rud.beta, rud.rud], rud.data[..., i])
    for rate, coefficients in (("p", LATERAL), ("q", LONGITUDINAL), ("r", LATERAL)):
        table = database[f"dC3_{rate}"]
        hat = getattr(table, f"{rate}hat")
        for i, c in enumerate(coefficients):
            keys = [ALPHA, f"aero/{rate}-hat-oscillatory"]
            lines += function(f"forced-{rate}/{c}", keys, [table.alpha, hat], table.data[:, :, i])
    rotary = database["dC6_w"]
    for i, c in enumerate(SIX):
        # stored as alpha x omega-hat x beta; JSBSim wants its third axis as the break points
        keys = [ALPHA, BETA, "aero/omega-hat"]
        values = rotary.data[..., i].transpose(0, 2, 1)
        lines += function(f"rotary/{c}", keys, [rotary.alpha, rotary.beta, rotary.what], values)
    return lines


def main(path: str) -> None:
    database = loadmat(path, squeeze_me=True, struct_as_record=False)
    target = HERE / "gtm-tables.xml"
    arguments, mark, _ = target.read_text().partition(MARK)  # what is looked up with stands above, written by hand
    target.write_text(arguments + mark + "\n".join(tables(database)) + "\n</aerodynamics>\n")


if __name__ == "__main__":
    main(sys.argv[1])
