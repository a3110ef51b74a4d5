"""A figure that a notebook shows: pyplot would teach the notebook to, and isn't needed for anything else."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

_DPI = 100


class ShownFigure(Figure):
    """A matplotlib Figure that is its own picture in a notebook."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=_DPI)
        return file.getvalue()
