"""What stands in other files of the kinds of faults, made of their classes: `python -m tests.project.kinds` writes it.

That is `gtmbench/api.py`, what `gtmbench list` says, the template of a scenario, a scenario of each kind that has none,
and rows of four tables in the documentation. A test compares them.
"""

import inspect
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from gtmbench.faults.fault import Fault
from gtmbench.faults.parameter import Parameter
from gtmbench.faults.registry import FAULTS, WORDS
from gtmbench.study.score import SAME_KINDS

ROOT = Path(__file__).parents[2]
FILES = {"additive": "added; as are", "shaping": "shapes it; as do", "replacing": "takes its place; as do"}
SURFACES = "float"  # the kind that no sensor has: no scenario of its own


def family(cls: type[Fault]) -> str:
    """Return the file of a class; one of its own stands with what shapes a signal."""
    file = cls.__module__.rpartition(".")[2]
    return file if file in FILES else "shaping"


def summary(cls: type[Fault]) -> str:
    """Return the first line of a class's docstring, as a terminal shows it."""
    return inspect.getdoc(cls).splitlines()[0].replace("``", "")


def api(text: str) -> str:
    """Return the public names with all classes of kinds."""
    names = sorted(cls.__name__ for cls in FAULTS.values())
    text = re.sub(r"    from gtmbench\.faults\.kinds\.\w+ import (\([^)]*\)|[^\n]*)\n", "", text)
    imports = "".join(f"    from {cls.__module__} import {cls.__name__}\n" for cls in FAULTS.values())
    text = text.replace("    from gtmbench.faults.parameter", f"{imports}    from gtmbench.faults.parameter")
    head, _, rest = text.partition("__all__ = [\n")
    listed = {*re.findall(r'"(\w+)"', rest), *names}
    text = head + "__all__ = [\n" + "".join(f'    "{name}",\n' for name in sorted(listed)) + "]\n"
    tidied = text.encode()
    for command in (["check", "--select", "I,RUF022", "--fix", "-q"], ["format", "-q"]):
        ruff = [sys.executable, "-m", "ruff", *command, "--stdin-filename", "gtmbench/api.py", "-"]
        tidied = subprocess.run(ruff, input=tidied, capture_output=True, check=True, cwd=ROOT).stdout
    return tidied.decode()


def listing(text: str) -> str:
    """Return what ``gtmbench list`` says, with a line a kind."""
    lines = [f"{kind} = {json.dumps(summary(cls), ensure_ascii=False)}\n" for kind, cls in FAULTS.items()]
    return re.sub(r"(\[faults\]\n)[^\[]*\n", lambda head: head[1] + "".join(lines) + "\n", text)


def template(text: str) -> str:
    """Return the template of a scenario, with the names of all kinds behind those that it shows."""
    told = set(re.findall(r'kind = "(\w+)"', text))
    for file, words in FILES.items():
        others = ", ".join(kind for kind, cls in FAULTS.items() if family(cls) == file and kind not in told)
        text = re.sub(rf"(# {words}) .*", rf"\1 {others}", text)
    return text


def unit_text(item: Parameter) -> str:
    """Return the unit of a parameter, or its default where it has no unit."""
    units = ["unit" if item.unit is None else item.unit] if item.value_type is float else []
    per = f" per {item.per}" if item.per else ""
    default = [] if item.is_required or item.default in (None, 0) or isinstance(item.default, bool) else [item.default]
    told = ", ".join(str(each) for each in ([f"{units[0]}{per}"] if units and units[0] else []) + default)
    return f"`{item.name}`" + (f" ({told})" if told else "")


def page(text: str) -> str:
    """Return the page of all kinds, with a row each in the table of its file."""
    for file, heading in (("additive", "Additive"), ("shaping", "Shaping"), ("replacing", "Replacing")):
        rows = [
            f"| `{kind}` | {summary(cls)} | {', '.join(map(unit_text, cls.parameters())) or 'none'} | {cls.occurs} |\n"
            for kind, cls in FAULTS.items()
            if family(cls) == file
        ]
        table = rf"(## {heading}\n\|[^\n]*\n\|[^\n]*\n)(?:\|[^\n]*\n)*"
        text = re.sub(table, lambda head, rows=rows: head[1] + "".join(rows).replace("|y|", "abs(y)"), text)
    words = "".join(f"| `{word}` | `{each.kind}` | {each.differs or 'nothing'} |\n" for word, each in WORDS.items())
    return re.sub(r"(?:\| `px4_\w+` \|[^\n]*\n)+", lambda _: words, text)


def keys(text: str) -> str:
    """Return the page of a scenario's keys, with the parameters of all kinds."""
    items = {item.name: item for cls in FAULTS.values() for item in cls.parameters()}
    of_unit = [name for name, item in items.items() if item.is_severity and item.unit is None]
    of_own = [name for name, item in items.items() if item.is_severity and item.unit is not None]
    others = [name for name, item in items.items() if not item.is_severity]
    for names, said in (
        (of_unit, "required by the kind (`.value`: 0)"),
        (of_own, "required by the kind"),
        (others, "by the kind"),
    ):
        listed = ", ".join(f"`.{name}`" for name in names).replace("`.", "`faults.", 1)
        text = re.sub(rf"\| `faults[^|]*\| {re.escape(said)} \|", lambda _, row=f"| {listed} | {said} |": row, text)
    return text


def diagnosis(text: str) -> str:
    """Return the page of a diagnosis, with the kinds of each family, and those that read the same."""
    families: dict[str, list[str]] = {}
    for kind, cls in FAULTS.items():
        if cls.shape is not None:
            families.setdefault(cls.shape.family, []).append(kind)
    for name, kinds in families.items():
        text = re.sub(rf"\| `{name}` \| [\w, ]+ \|", f"| `{name}` | {', '.join(kinds)} |", text)
    same = []
    for (kind, told), each in SAME_KINDS.items():
        when = inspect.getdoc(each.reads).removesuffix(".").removeprefix("Whether ").replace("Whatever", "whatever")
        same.append(f"| `{kind}` | `{told}` | {when} | {each.why} |\n")
    return re.sub(r"(?:\| `\w+` \| `\w+` \|[^\n]*\n)+", lambda _: "".join(same), text)


PLACES: dict[str, Callable[[str], str]] = {
    "gtmbench/api.py": api,
    "gtmbench/cli/names.toml": listing,
    "gtmbench/cli/template.toml": template,
    "docs/reference/faults.md": page,
    "docs/reference/scenario_keys.md": keys,
    "docs/explanation/diagnosis.md": diagnosis,
}


def scenario(cls: type[Fault]) -> str:
    """Return a scenario of a kind: one rate gyro at a time, of the size that its class calls strong."""
    typical, shape = cls.typical, cls.shape
    given = {} if typical is None else dict(typical.shown)
    if typical is not None and shape is not None and shape.figure in given:
        given[shape.figure] = f"{typical.gyro[-1]:g} % of {typical.of}" if typical.of else typical.gyro[-1]
    lines = [f"{name} = {json.dumps(value)}" for name, value in given.items()]
    first = summary(cls).partition(":")[0].rstrip(".")
    title = f"{cls.kind.replace('_', ' ').capitalize()} of a rate gyro"
    head = [f"# {first}, one rate gyro at a time.", f'title = "{title}"', "", "[[faults]]", f'kind = "{cls.kind}"']
    return "\n".join([*head, 'channels = ["p", "q", "r"]', "onset_s = 300.0", *lines, ""])


def wanted() -> Iterator[tuple[Path, str]]:
    """Yield each file with the text that it should have."""
    for name, made in PLACES.items():
        path = ROOT / name
        yield path, made(path.read_text(encoding="utf-8"))
    for kind, cls in FAULTS.items():
        path = ROOT / "faults" / f"{kind}.toml"
        if kind != SURFACES and not path.exists():
            yield path, scenario(cls)


def main() -> None:
    """Write what differs."""
    for path, text in list(wanted()):
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()
