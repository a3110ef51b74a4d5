"""Every public name tells what it is and shows how it is used; the examples themselves run as doctests."""

import ast
import builtins
import doctest
import inspect
import re

import pytest

import gtmbench as gb
from gtmbench import api
from gtmbench.faults.registry import FAULTS

TABLES = {"CHANNELS": gb.Channel, "PSEUDO_INPUTS": gb.PseudoInput}  # told of where their rows are
SLOW = {"find_autopilot"}  # minutes: its example shows what it begins with
VALUES = (gb.Record, gb.Transmissibility, gb.Watch, gb.Study, gb.Trial, gb.Alarm, gb.WatchedLog, gb.FlightLog)


def texts():
    """Yield what each public name is told to be."""
    for name in api.__all__:
        yield name, inspect.getdoc(TABLES.get(name, getattr(gb, name)))


def test_every_public_name_has_an_example():
    for name, text in texts():
        section = re.search(r"^Examples\n-{8}\n(.*)", text, flags=re.MULTILINE | re.DOTALL)
        assert section, f"{name} has no section Examples"
        assert ">>> " in section[1], name
        if inspect.isfunction(getattr(gb, name)) and name not in SLOW:
            assert re.search(rf"\b{name}\b", section[1]), f"{name} isn't in its own example"


def test_every_example_can_be_pasted():
    """It defines or imports all that it uses: doctests would find what stands in the module."""
    for name, text in texts():
        examples = doctest.DocTestParser().get_examples(text)
        nodes = list(ast.walk(ast.parse("".join(example.source for example in examples))))
        used = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
        made = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        made |= {node.arg for node in nodes if isinstance(node, ast.arg)}
        made |= {node.name for node in nodes if isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.ExceptHandler))}
        made |= {alias.asname or alias.name for node in nodes if hasattr(node, "names") for alias in node.names}
        assert used - made <= set(dir(builtins)), name


def test_no_docstring_breaks_when_it_is_rendered():
    """Literals are closed, and a bar isn't taken for a substitution."""
    for name, text in texts():
        plain = re.sub(r"``.*?``", "", text.split("Examples\n--------\n")[0], flags=re.DOTALL)
        assert plain.count("`") % 2 == 0, name
        assert not re.search(r"(?<!\S)\(?\|\S[^|\n]*\|(?![\w^|])", plain), f"{name}: |x| would be a substitution"
        plain = re.sub(r"\*\w[^*\n]*\*", "", plain)  # an emphasis that ends
        assert not re.search(r"(?<![`\w*])\*\w", plain), f"{name}: *x would begin an emphasis"


@pytest.mark.parametrize("kind", FAULTS)
def test_every_parameter_of_a_fault_is_told_of_where_it_stands(kind):
    text = inspect.getdoc(FAULTS[kind])
    told = re.findall(r"^(\w+) : ", text, flags=re.MULTILINE)
    assert told == [parameter.name for parameter in FAULTS[kind].parameters()]


@pytest.mark.parametrize("of", VALUES, ids=lambda of: of.__name__)
def test_methods_of_the_main_values_are_told_of(of):
    for name, member in inspect.getmembers(of):
        told = inspect.isfunction(member) or isinstance(member, property)
        if told and not name.startswith("_"):
            assert len(inspect.getdoc(member) or "") > 10, f"{of.__name__}.{name}"


def test_only_public_names_are_listed():
    assert set(dir(gb)) == {*api.__all__, "__version__"}
