"""The study of odd readings: each changes what it says and nothing else, and a wrong one is no all-clear."""

import numpy as np
import pandas as pd
import pytest

import odd_readings as study
from gtmbench.values.channels import ATTITUDE, GYROS
from recorded.flights import CHANNELS, LogFile
from tests.helpers.night import by_day

CHEAP = ("attitude 0.1 s late", "r 1.4", "q a copy of p", "attitude 0.05 s late")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return a written flight."""
    (path,) = study.synthetic(tmp_path_factory.mktemp("logs"), range(66_001, 66_002))
    return path


@pytest.fixture(scope="module")
def rows(path):
    """Return what is said of it in some ways."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "READINGS", {name: study.READINGS[name] for name in CHEAP})
        return pd.DataFrame(study.cases(path))


def touched(name):
    """Return the channels that a reading's name speaks of."""
    if "attitude" in name:
        return {*ATTITUDE}
    return {*GYROS} if "gyros" in name else {word.strip(",") for word in name.split()} & {*CHANNELS}


@pytest.mark.parametrize("name", by_day(study.READINGS, 8, seed=78))
def test_a_reading_changes_the_channels_that_it_names(name, path):
    (part, *_) = LogFile(path, path.name).parts()
    read = study.READINGS[name].mutate(part)
    changed = {channel for channel in CHANNELS if not np.allclose(read[channel], part[channel], atol=1e-9)}
    assert changed
    assert changed <= touched(name)


@pytest.mark.nightly
def test_no_wrong_reading_ends_with_an_all_clear_or_accuses(rows):
    assert set(rows["rate"]) == {"as logged", "slowed"}
    wrong = rows[rows["kind"] == study.WRONG]
    assert len(wrong) == 4
    assert not wrong["exit"].isin([0, 1]).any()
