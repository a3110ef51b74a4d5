"""Figures of choices: the surface over r and d, and the residual against the number of inputs (as Fig. 4.6)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gtmbench.method.selection.excitations import ExcitationCount
from gtmbench.method.selection.orders import OrderChoice
from gtmbench.report.figures.panels import panels
from gtmbench.report.style import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LABELS = {"heldout": "held-out residual over the outputs' RMS"}


def order_figure(choice: OrderChoice, *, name: str | None = None) -> Figure:
    """Draw a column of the table over r and d, the recommendation marked.

    `name`: the column; what the recommendation stands on unless told: ``heldout`` if there is one, else ``bic``.
    """
    wanted = name or ("heldout" if "heldout" in choice.table else "bic")
    surface = choice.surface(wanted)
    figure, axes = panels(1, 1, (6.4, 5.0))
    axis = axes[0][0]
    # a residual spans decades; of a criterion only differences count, so it is drawn above its least
    residual = wanted.startswith(("heldout", "rms"))
    values = surface if residual else surface - surface.min(axis=None) + 1.0
    drawn = axis.imshow(values, origin="lower", cmap="viridis", aspect="auto", norm="log")
    label = _LABELS.get(wanted, wanted) if residual else f"{wanted} above its least, plus 1"
    figure.colorbar(drawn, ax=axis, label=label)
    axis.grid(visible=False)
    axis.set_xticks(range(surface.shape[1]), [str(d) for d in surface.columns])
    axis.set_yticks(range(surface.shape[0]), [str(r) for r in surface.index])
    at = surface.columns.get_loc(choice.noncausal_order), surface.index.get_loc(choice.causal_order)
    axis.plot(*at, "o", ms=14, mfc="none", mec=COLOURS["threshold"], mew=2.5)
    axis.set_xlabel("d (samples ahead)")
    axis.set_ylabel("r (samples back)")
    axis.set_title(f"recommended: r = {choice.causal_order}, d = {choice.noncausal_order}")
    return figure


def excitation_figure(count: ExcitationCount) -> Figure:
    """Draw the relative residuals of all choices of inputs and all outputs against m, and the curve that is read."""
    figure, axes = panels(1, 1, (6.4, 4.2))
    axis = axes[0][0]
    axis.plot(count.table["m"], count.table["relative_residual"], ".", color=COLOURS["healthy"], ms=5, alpha=0.6)
    curve = count.by_m
    axis.plot([0, *curve.index], [1.0, *curve], "o-", color=COLOURS["p"], label="best choice of inputs, RMS of outputs")
    if count.excitations is not None:
        axis.axvline(count.excitations, color=COLOURS["threshold"], ls="--", label=f"{count.excitations} excitations")
    axis.set_yscale("log")
    axis.set_xticks([0, *curve.index])
    axis.set_xlabel("m, number of pseudo inputs (dots: every choice, every output)")
    axis.set_ylabel("residual RMS over the output's RMS")
    axis.legend(loc="best", fontsize="small")
    return figure
