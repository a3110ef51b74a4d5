"""What users read is plain: no riddle stands in docs, README, public docstrings or help texts.

Each banned expression stands beside a better wording. Code, links' targets and quotes of the program's output (code,
or *italics*) may hold it.
"""

import ast
import inspect
import re
from functools import cache

import click
import pytest

import gtmbench as gb
from gtmbench import api, testing
from tests.helpers.commands import COMMANDS
from tests.helpers.pages import ROOT

BETTER = {  # a regular expression, and what to write
    r"nothing was said about": "Cannot watch this log: no gyro column has a known unit.",
    r"\bwitness(es)?\b": "used for diagnosis only, never for alarms",
    r"explained where identified|\bwhere identified\b": "on the training part; in the identified part",
    r"\b(a drift|one) below [\d.]+ \S+ passes\b": "drifts slower than ... are not detected",
    r"\bknown \d[\d.]* s later\b": "latency ... s",
    r"\btold apart\b|\btells? apart\b": "isolable; isolated; separated",
    r"is all that this length shows": "too short to bound the rate (95 % upper bound ... an hour)",
    r"not seen to end": "still present at the end of the log",
    r"not even the largest": "even the largest fault tried was detected this rarely",
    r"\bwould have been seen\b": "would have been detected",
    r"\baltered \d+ %": "samples changed by the fault",
    r"as the scenarios? expects?\b": "expectations met: ... of ... scenarios",
    r"minus true": "error against the truth",
    r"\bwithout a residual\b": "cannot test here (gap, or waiting for samples)",
    r"\(there: ": "(found: ...)",
    r"too few windows of": "this log has ... samples a second; at least 10 are needed",
    r"\bwho sees what\b|\bwho is who\b|\bwho (lies|parts|says|names) ": "detector comparison; which sensor ...",
    r"\bunless told\b": "by default",
    r"can't be meant|can be meant|to be meant": "is invalid",
    r"\bheld against\b|\bholds? (it|them|that|two|yours|every) against\b": "compared with",
    r"\bat what price\b": "at which false alarm rate",
    r"\bhow soon\b|\bwho is soon": "detection delay",
    r"\bwhat it is worth\b|\bis worth something\b": "how well it works; its accuracy",
    r"\bfor good\b": "permanently",
    r"\bof its own accord\b": "automatically",
    r"\btells? of\b|\btold of\b|\btelling of\b": "reports; shows; records",
    r"\bhears?\b|\bheard\b": "reads; watches",
    r"\bmust be told\b|\bis told of\b": "is stated",
    r"\bgoes by the name\b|\bgo by the name\b": "is called",
    r"\bfalse-alarm rate": "false alarm rate",
    r"\bvirtual sensors?\b(?!\)|\*)": "predicted reading (virtual sensor)",
    r"\blevels? over (its|their) thresholds?\b|\bscores? over (its|their) thresholds?\b": "test statistics over ...",
    r"\bwhat (stands|lies) (there|beside|between)\b": "the parts between ...; its value",
    r"\bmeans anything\b|\bmeans? nothing\b": "is (not) valid",
    r"\b[Ww]hat (is|was) (said|told|drawn|held|asked)\b": "name the thing: the verdict, the random draw, the state",
    r"\bwhat (it|they|a \w+|an \w+|the \w+) makes? of\b": "the result of ... on ...",
    r"\bwhat became of\b": "the treatment of ...",
    r"\bis undone\b|\bundoes\b": "is corrected; is removed",
    r"\bwhat watches\b": "the detector",
    r"\bwhat breaks\b": "the fault",
    r"\bof what is\b": "name the thing",
    r"\btaken in\b|\btakes it in\b": "read",
    r"\bstands? on\b": "rests on; uses; assumes",
    r"\bone's own\b": "your own",
    r"\b(said|says?) of\b": "reported on",
    r"\basks? of\b|\basked of\b": "required of; read from",
    r"\bnobody wrote\b": "without a ...",
    r"\bcan(not|'t) be told\b": "end with *can't tell*; have no verdict",
}
QUOTED = r"```.*?```|:::.*?:::|``.*?``|`[^`\n]*`|(?<![*\w])\*(?!\*)[^*\n]+\*(?!\*)|\$\$.*?\$\$"
TABLES = {"CHANNELS": gb.Channel, "PSEUDO_INPUTS": gb.PseudoInput}
PAGES = [ROOT / "README.md"]
PAGES += [page for page in sorted((ROOT / "docs").rglob("*.md")) if "generated" not in page.parts]
PAGES.remove(ROOT / "docs/reference/dissertation.md")  # `make experiments` writes it, from the scripts' own titles


def plain(text):
    """Return a text without code, quotes, links' targets and indented blocks, in one line a paragraph."""
    text = re.sub(QUOTED, "", text, flags=re.DOTALL)
    text = re.sub(r"^(    |>>> ).*$", "", text, flags=re.MULTILINE)
    return re.sub(r"\]\([^)]*\)", "]", text)


def riddles(text):
    """Return the banned expressions in a text, with what to write."""
    line = " ".join(plain(text).split())
    return {found[0]: better for banned, better in BETTER.items() if (found := re.search(banned, line, re.IGNORECASE))}


@cache
def docstrings():
    """Return the public names' docstrings, and those of their public members, without examples."""
    texts = {}
    for name in (*api.__all__, *(f"testing.{each}" for each in testing.__all__ if callable(getattr(testing, each)))):
        value = TABLES.get(name) or (getattr(testing, name[8:]) if name.startswith("testing.") else getattr(gb, name))
        members = vars(value).items() if inspect.isclass(value) else ()
        told = {name: value} | {f"{name}.{key}": each for key, each in members if not key.startswith("_")}
        texts |= {
            key: (inspect.getdoc(each) or "").split("Examples\n--------\n")[0]
            for key, each in told.items()
            if callable(each) or isinstance(each, property)
        }
    return texts


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_riddle_stands_in_a_page(page):
    assert riddles(page.read_text()) == {}


def test_no_riddle_stands_in_a_public_docstring():
    texts = {name: re.sub(r"^    |^\w+( : .*)?$", "", text, flags=re.MULTILINE) for name, text in docstrings().items()}
    assert len(texts) > 300
    assert {name: found for name, text in texts.items() if (found := riddles(text))} == {}


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_no_riddle_stands_in_a_help_text(name):
    command = COMMANDS[name]
    options = [each.help or "" for each in command.params if isinstance(each, click.Option)]
    assert all(text.endswith((".", "]", "]).", "...")) for text in options), "a help text is a whole sentence"
    assert {text: found for text in (command.help, *options) if (found := riddles(inspect.cleandoc(text)))} == {}


def test_a_term_stands_once_in_the_glossary():
    terms = re.findall(r"^\| ([^|]+) \|", (ROOT / "docs/reference/glossary.md").read_text(), flags=re.MULTILINE)
    terms = [term for term in terms if term not in {"term", "---"}]
    assert len(terms) > 50
    assert len(set(terms)) == len(terms)


def test_a_riddle_would_be_found():
    assert set(riddles("What it is worth: `unless told`,\nwho sees\nwhat.")) == {"What it is worth", "who sees what"}


def printed(path):
    """Yield the texts of a module that aren't documentation: what a user may get to read, figures filled in."""
    tree = ast.parse(path.read_text())
    documented = {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "3.1" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in documented:
            yield node.value


def test_no_riddle_is_printed():
    """Some stay: a term of the glossary in the figures' legends, and plain English in errors about digests."""
    allowed = {"virtual sensor", "can't be told", "How soon"}
    texts = {text for path in sorted((ROOT / "gtmbench").rglob("*.py")) for text in printed(path) if " " in text}
    assert len(texts) > 3000
    assert {text: found for text in texts if (found := riddles(text)) and not found.keys() <= allowed} == {}
