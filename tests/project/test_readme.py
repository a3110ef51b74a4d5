"""The README tells the truth, in a page: its commands and its Python run, its files exist."""

import re
import shlex
import tomllib

import pytest

from gtmbench.version import __version__
from tests.helpers.commands import COMMANDS
from tests.helpers.pages import ROOT, blocks, commands, run_chain

PAGE = ROOT / "README.md"
README = PAGE.read_text()
MAKEFILE = (ROOT / "Makefile").read_text()


def mentioned():
    """Return the commands within sentences; a number stands for what is left open."""
    sentences = re.sub(r"```.*?```", "", README, flags=re.DOTALL).replace("\n", " ")
    return [line.replace(" N", " 7") for line in re.findall(r"`(gtmbench [a-z][^`]*)`", sentences)]


@pytest.mark.parametrize(
    "line", sorted({line for line in (*commands(PAGE), *mentioned()) if line.startswith("gtmbench")})
)
def test_every_command_parses(line):
    _, command, *arguments = shlex.split(line)
    assert command in COMMANDS
    if arguments or line in commands(PAGE):
        COMMANDS[command].make_context(command, arguments)


def test_every_make_target_exists():
    wanted = re.findall(r"`make (\w+)`", README)
    assert {"run", "test", "docs"} <= {*wanted}
    for target in wanted:
        assert re.search(rf"^{target}:", MAKEFILE, flags=re.MULTILINE), target


CHEAP = {  # what is added to a command
    "gtmbench run drift jam": "--no-figures --no-recording",
    "gtmbench run jam": "--no-figures",
    "gtmbench live": "--learn 25 --end-after 8",
    "gtmbench fly --live": "--duration 60 --onset 55 --speed 10",
}


@pytest.mark.nightly
def test_the_commands_run_as_one_chain(tmp_path, monkeypatch, capsys):
    """In one folder, each with what those before it wrote; a shorter `demo` is run by test_json_contract."""
    chain = [line for line in commands(PAGE) if line.startswith("gtmbench") and line != "gtmbench demo"]
    assert len(chain) >= 7
    codes = {"gtmbench monitor broken.csv": 1}
    printed = " ".join(run_chain(chain, tmp_path, monkeypatch, capsys, cheap=CHEAP, codes=codes).split())
    verdicts = [" ".join(block.split()) for block in blocks(PAGE, "text")]
    assert len(verdicts) == 2
    assert [verdict for verdict in verdicts if verdict not in printed] == []


@pytest.mark.nightly
def test_the_python_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks(PAGE, "python")), {})
    assert re.fullmatch(r"1 \[\(4\d\.\d+, 'q failed'\)\]\n", capsys.readouterr().out)


def test_it_is_a_page_and_every_file_that_is_named_exists():
    text = README + (ROOT / "experiments/README.md").read_text()
    assert len(README.splitlines()) <= 120
    assert len(README) <= 12_000
    named = re.findall(r"`((?:gtmbench|aircraft|experiments|faults|tests)/[\w./]+)`", text)
    pictures = re.findall(r"\]\((experiments/[^)]+)\)", text)
    assert len(named) > 2
    assert len(pictures) == 1
    for name in named + pictures:
        if "NAME" not in name:
            assert (ROOT / name).exists(), name


def test_it_is_cited_with_the_version_that_it_has():
    cited = (ROOT / "CITATION.cff").read_text()
    assert re.search(rf"^version: {re.escape(__version__)}$", cited, flags=re.MULTILINE)
    title = re.search(r'^title: "(.*)"$', cited, flags=re.MULTILINE)[1]
    assert f"# {title}\n" in (ROOT / "docs/paper.md").read_text()
    described = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert described["authors"][0]["name"] in cited
