"""The house has a budget: no room grows unless somebody raises its figure in `budget.toml` and writes why."""

import tomllib
from pathlib import Path

from tests.project.budget import measured

FIGURES = tomllib.loads((Path(__file__).parent / "budget.toml").read_text(encoding="utf-8"))["rooms"]
SLACK = 0.03  # of a figure: what a room has shrunk by without the figure following it
LEAST_SLACK = 5  # lines, of a small room


def complaints(rooms, figures):
    """Return what is wrong with a budget, a line each."""
    lines = []
    for room in sorted({*rooms, *figures}):
        has, may = rooms.get(room, 0), figures.get(room)
        if may is None:
            lines.append(f'{room}: {has} lines of code, and no figure in budget.toml; add it: "{room}" = {has}')
        elif has > may:
            lines.append(
                f"{room}: {has} lines of code, {has - may} above its {may}; make it smaller, or raise the figure in "
                "budget.toml and write the reason beside it"
            )
        elif not has:
            lines.append(f"{room}: no such room; delete its figure from budget.toml")
        elif may - has > max(SLACK * has, LEAST_SLACK):
            lines.append(f"{room}: only {has} lines of code are left of its {may}; lower the figure in budget.toml")
    return lines


def test_no_room_is_above_its_figure_and_every_figure_is_near():
    assert not (found := complaints(measured(), FIGURES)), "\n".join(found)


def test_a_room_is_a_folder_and_the_modules_beside_the_folders_are_one(tmp_path):
    for name in ("top.py", "other.py", "room/__init__.py", "room/a.py", "room/within/b.py", "empty/__init__.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text('"""Text."""\n' if "__init__" in name else "x = 1\ny = 2\n")
    assert measured(tmp_path) == {".": 4, "room": 2, "room/within": 2}
