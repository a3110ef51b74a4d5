"""Faults of a user's own: known by name once registered, imported or installed, and by themselves anyway."""

import json
import subprocess
import sys
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from gtmbench.errors import InputError
from gtmbench.faults import registry
from gtmbench.faults.fault import Fault, inject, other_channel, setting, severity
from gtmbench.faults.kinds.additive import Drift
from gtmbench.faults.kinds.replacing import Jam
from gtmbench.faults.parameter import flag, random_seed
from gtmbench.faults.registry import FAULTS, fault_kinds, find_fault, import_package, register_fault
from gtmbench.study.fault_tables import build, resolve, spec_of
from gtmbench.study.scenario import load_scenario
from gtmbench.values.record import Record
from tests.helpers.night import by_day

OWN = """
from dataclasses import dataclass
from gtmbench.faults.fault import Fault, severity
from gtmbench.faults.registry import register_fault


@register_fault
@dataclass(frozen=True, kw_only=True)
class BiasStep(Fault):
    kind = "bias_step"
    size: float = severity(per_second=False)

    def distort(self, readings, elapsed_s, sample_period_s, carried):
        return readings[:, 0] + self.size, None
"""
TABLE = '[[faults]]\nkind = "{kind}"\nchannels = ["p", "q"]\nonset_s = 300.0\nsize = [0.5, "20 % of rms"]\n'


@dataclass(frozen=True, kw_only=True)
class Stuck(Fault):
    """A kind with a field that no scenario can say, defined anywhere and not registered."""

    kind: ClassVar[str] = "stuck"
    level: float = severity(per_second=False)
    label: str = "unset"

    def distort(self, readings, elapsed_s, sample_period_s, carried):
        return np.full(len(readings), self.level), None


def test_of_all_fields_severities_alone_say_how_bad_it_is():
    @dataclass(frozen=True, kw_only=True)
    class Everything(Fault):
        kind = "everything"
        size: float = severity()
        rate_hz: float = setting(unit="Hz", default=3.0)
        other: str = other_channel()
        is_loud: bool = flag()
        seed: int = random_seed()

    fault = Everything(channel="p", onset_s=0.0, size=2.0, other="q")
    assert fault.severities == {"size": 2.0}
    assert (fault.rate_hz, fault.is_loud, fault.seed, fault.reads) == (3.0, False, 0, ("p", "q"))


@pytest.fixture(autouse=True)
def only_built_in(monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN)
    return path


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a function that installs a package which announces kinds, as pip would."""
    modules = set(sys.modules)

    def install(name, announced, text=OWN):
        site = tmp_path / "site"
        (site / f"{name}-1.0.dist-info").mkdir(parents=True)
        (site / f"{name}.py").write_text(text)
        (site / f"{name}-1.0.dist-info/METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        points = "\n".join(f"{kind} = {source}" for kind, source in announced.items())
        (site / f"{name}-1.0.dist-info/entry_points.txt").write_text(f"[gtmbench.faults]\n{points}\n")
        monkeypatch.syspath_prepend(str(site))

    yield install
    for name in set(sys.modules) - modules:
        del sys.modules[name]


@pytest.fixture
def load(tmp_path):
    def written(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return load_scenario(path)

    return written


def test_a_registered_kind_is_known_by_its_name(own):
    assert import_package(str(own)) == ("bias_step",)
    assert fault_kinds() == (*FAULTS, "bias_step")
    fault = find_fault("bias_step")(channel="p", onset_s=1.0, size=2.0)
    record = Record(np.zeros(4), channels=["p"], sample_period_s=1.0)
    assert inject(record, fault)["p"].tolist() == [0.0, 2.0, 2.0, 2.0]
    assert import_package(str(own)) == ("bias_step",)  # asked for twice, it is the same


def test_a_scenario_says_a_registered_kind_like_any_other(own, load):
    import_package(str(own))
    specs = load(TABLE.format(kind="bias_step")).faults
    assert [(spec.kind, spec.channel, spec.severities["size"].of) for spec in specs] == [
        ("bias_step", channel, of) for channel in "pq" for of in (None, "rms")
    ]
    flight = Record([1.0, -1.0], channels=["p"], sample_period_s=1.0)
    fault = build(specs[1], {"size": resolve(specs[1].severities["size"], flight, "p")})
    assert fault.severities == {"size": pytest.approx(0.2)}
    with pytest.raises(
        InputError, match=r"unknown key 'limit'; a bias_step has kind, channels, onset_s, .*, unit, also, expect, size$"
    ):
        load(TABLE.format(kind="bias_step") + "limit = 3.0")


@pytest.mark.parametrize("kind", by_day(["bias_step", "evil:thing", "evil.thing", "./evil.py:Thing", "evil"], 2))
def test_a_scenario_imports_nothing(tmp_path, kind):
    """Whatever a data file says, no module of the user's is imported: in a process of its own, to see all of them."""
    (tmp_path / "evil.py").write_text(OWN)
    (tmp_path / "mine.toml").write_text(TABLE.format(kind=kind))
    script = (
        "import sys, json\nsys.path.insert(0, '')\nfrom gtmbench.study.scenario import load_scenario\n"
        "try:\n    load_scenario('mine.toml')\nexcept ValueError as error:\n"
        "    print(json.dumps([str(error), [name for name in sys.modules if 'evil' in name]]))"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    message, imported = json.loads(done.stdout)
    assert f"kind is '{kind}'; there are bias, drift, thermal_bias" in message
    assert imported == []


def test_an_installed_kind_is_listed_without_importing_and_imported_when_named(package, load):
    package("own_faults_a", {"bias_step": "own_faults_a:BiasStep"})
    assert fault_kinds() == (*FAULTS, "bias_step")
    load(TABLE.format(kind="drift").replace('size = [0.5, "20 % of rms"]', "slope = 0.1"))
    assert "own_faults_a" not in sys.modules
    assert load(TABLE.format(kind="bias_step")).faults[0].fault.severities == {"size": 0.5}
    assert "own_faults_a" in sys.modules


def test_a_package_doesnt_replace_what_is_built_in(package):
    package("own_faults_b", {"drift": "own_faults_b:BiasStep"})
    assert find_fault("drift") is Drift
    assert fault_kinds() == tuple(FAULTS)


@pytest.mark.parametrize(
    ("source", "text", "message"),
    [
        (
            "own_faults_c:BiasStep",
            OWN,
            r"own_faults_c\.BiasStep is announced as kind 'hers', but calls itself 'bias_step'",
        ),
        ("own_faults_c:Fault2", OWN, r"own_faults_c has no 'Fault2'"),
        ("own_faults_c:dataclass", OWN, r"is no kind of fault; derive a class from gb\.Fault"),
        ("own_faults_c:BiasStep", "1/0", r"own_faults_c can't be imported: ZeroDivisionError: division by zero"),
    ],
)
def test_what_a_package_announces_wrongly_is_said_in_one_line(package, load, source, text, message):
    package("own_faults_c", {"hers": source}, text)
    with pytest.raises(InputError, match=message) as refused:
        load(TABLE.format(kind="hers"))
    assert "\n" not in str(refused.value)


def test_two_packages_that_announce_one_kind_are_both_named(package, load):
    package("own_faults_d", {"bias_step": "own_faults_d:BiasStep"})
    package("own_faults_e", {"bias_step": "own_faults_e:BiasStep"})
    with pytest.raises(InputError, match=r"own_faults_d:BiasStep or own_faults_e:BiasStep: two packages announce it"):
        load(TABLE.format(kind="bias_step"))


def test_a_field_with_a_default_needs_no_declaration():
    cls = made(__annotations__={"label": str}, label="unset")
    assert register_fault(cls) is find_fault("own_kind") is cls


def made(**members):
    """Return a class of a user's that lacks or has what is given."""
    whole = {"kind": "own_kind", "distort": lambda *_: None, "__module__": "hers", "__qualname__": "Own", **members}
    return dataclass(frozen=True, kw_only=True)(
        type("Own", (Fault,), {k: v for k, v in whole.items() if v is not None})
    )


@pytest.mark.parametrize(
    ("cls", "message"),
    [
        (
            lambda: made(kind=None),
            r"hers\.Own: kind is None; give a name of small letters, digits and _, as 'bias_step'",
        ),
        (lambda: made(kind="Bias step"), "kind is 'Bias step'"),
        (lambda: made(kind="a:b"), "kind is 'a:b'"),
        (lambda: made(kind="../x"), "kind is '../x'"),
        (lambda: made(kind="x" * 41), "kind is 'xxx"),
        (lambda: made(kind=7), "kind is 7"),
        (lambda: made(distort=None), r"hers\.Own has no distort; define how it changes the samples"),
        (
            lambda: made(kind="drift"),
            r"kind 'drift' of hers\.Own is taken by gtmbench\.faults\.kinds\.additive\.Drift; give it another",
        ),
        (
            lambda: made(__annotations__={"size": float}),
            r"hers\.Own: declare 'size' by severity\(\) or other_channel\(\)",
        ),
        (
            lambda: type("Own", (Jam,), {"kind": "own"}),
            r"isn't a frozen dataclass; put @dataclass\(frozen=True, kw_only=True\)",
        ),
        (lambda: "drift", "'drift' is no kind of fault; derive a class from"),
        (lambda: int, "is no kind of fault"),
    ],
)
def test_what_is_no_kind_of_its_own_is_refused(cls, message):
    with pytest.raises(InputError, match=message) as refused:
        register_fault(cls())
    assert "\n" not in str(refused.value)
    assert fault_kinds() == tuple(FAULTS)


def test_a_kind_is_taken_by_the_first_and_the_same_class_may_come_again():
    first, again = made(), made()
    other = made(__qualname__="Another")
    assert register_fault(first) is first
    with pytest.raises(InputError, match=r"kind 'own_kind' of hers\.Another is taken by hers\.Own"):
        register_fault(other)
    register_fault(again)  # a notebook's cell that is run again
    assert find_fault("own_kind") is again


def test_an_import_that_fails_says_with_what(tmp_path):
    with pytest.raises(InputError, match=r"no file .*none\.py"):
        import_package(str(tmp_path / "none.py"))
    (tmp_path / "bad.py").write_text(OWN.replace('"bias_step"', '"drift"'))
    with pytest.raises(
        InputError, match=r"bad\.py: kind 'drift' of .*BiasStep is taken by gtmbench\.faults\.kinds\.additive\.Drift"
    ):
        import_package(str(tmp_path / "bad.py"))


def test_a_ready_fault_of_any_class_is_a_trial_as_it_stands():
    fault = Stuck(channel="q", onset_s=2.0, duration_s=1.0, level=3.0, label="hers")
    spec = spec_of(fault, flight_s=10.0)
    assert (spec.kind, spec.channel, spec.onset_s, spec.duration_s) == ("stuck", "q", 2.0, 1.0)
    assert build(spec, {name: resolve(share, None, "q") for name, share in spec.severities.items()}) == fault


@dataclass(frozen=True, kw_only=True)
class Leak(Stuck):
    kind: ClassVar[str] = "leak"
    source: str = other_channel()


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("jam", r"'jam' is no fault with a kind; give one such as Jam\(channel='p', onset_s=300\)"),
        (Stuck, "is no fault with a kind"),
        (
            Stuck(channel="q", onset_s=20.0, level=1.0),
            "stuck: onset_s is 20.0; it must be a finite number, 0 or more, at most 10",
        ),
        (Stuck(channel="q", onset_s=-1.0, level=1.0), "stuck: onset_s is -1.0"),
        (Stuck(channel="flaps", onset_s=1.0, level=1.0), "stuck: channels"),
        (Leak(channel="q", onset_s=1.0, level=1.0, source="nose"), "leak: channels.*'nose'"),
    ],
)
def test_a_ready_fault_that_cant_be_tried_is_refused_before_the_flight(fault, message):
    with pytest.raises(InputError, match=message):
        spec_of(fault, flight_s=10.0)
