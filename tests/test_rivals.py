"""Rivals: every one keeps the contract; what each stands on holds."""

from dataclasses import dataclass
from functools import cache

import pytest

import gtmbench as gb
from gtmbench.detectors.rivals.catalogue import RIVALS
from gtmbench.detectors.rivals.isolation_forest import IsolationForest
from gtmbench.testing.contract.case import contract_case
from gtmbench.testing.contract.suite import CONTRACT, check_property


@dataclass(frozen=True, kw_only=True)
class Lax(IsolationForest):
    """Wanted to alarm falsely: of four minutes no rare score can be told, and its own can't pass 1."""

    def calibrate(self, records, false_alarms_per_hour=None, **more):
        return super().calibrate(records, 100.0 if false_alarms_per_hour is None else false_alarms_per_hour, **more)


LOUD = [
    gb.Noise(channel=gyro, onset_s=at, deviation=300.0, seed=1, duration_s=12.0) for gyro in "pqr" for at in (48, 84)
]


@cache
def case_of(name):
    return contract_case(Lax(), fault=LOUD) if name == "isolation-forest" else contract_case(name)


@pytest.mark.parametrize("prop", CONTRACT)
@pytest.mark.parametrize("name", RIVALS)
def test_every_rival_keeps_the_contract(name, prop):
    check_property(case_of(name), prop)
