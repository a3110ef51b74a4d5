"""Each known source is read as its documentation says, without an option; a table like one of none is asked about."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.intake.formats.dialects import dialects
from gtmbench.intake.read import read_log
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from tests.helpers.dialect_samples import SAMPLES
from tests.helpers.log_makers import flight
from tests.helpers.night import by_day

OF = {"gyroflow": GYROS, "phyphox_tables": (*GYROS, *ACCELEROMETERS), "emlid": ("altitude",)}


@pytest.fixture(scope="module")
def truth():
    """Half a minute at 50 Hz, with the forces of a slow flight."""
    table = flight(40.0)
    noise = np.random.default_rng(70).standard_normal((len(table), 3)) * 0.02
    f, t = np.deg2rad(table.phi), np.deg2rad(table.theta)
    down = np.column_stack([np.sin(t), -np.cos(t) * np.sin(f), np.cos(t) * np.cos(f)]) + noise
    return table.assign(**dict(zip(ACCELEROMETERS, down.T, strict=True)))


def written(files, folder):
    """Write a sample; return the only file or folder of it, or where it lies."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    tops = {name.partition("/")[0] for name in files}
    return folder / tops.pop() if len(tops) == 1 else folder


def check(log, truth, channels=(*GYROS, *ATTITUDE)):
    """Whatever is read is the truth: in its unit, with its sign, when it was."""
    (record,) = log.segments
    assert set(channels) <= set(record.channels)
    assert record.end_s - record.start_s == pytest.approx(truth.time_s.iloc[-1], abs=0.1)
    for name in {*GYROS, *ATTITUDE, *ACCELEROMETERS} & set(record.channels):
        expected = np.interp(record.time_s - record.start_s, truth.time_s, truth[name])
        read = record[name] - (360.0 * np.round(np.mean(record[name] - expected) / 360.0) if name == "psi" else 0.0)
        assert np.nanstd(read - expected) < 0.06 * np.std(expected) + 0.01, name
        assert abs(np.nanmean(read - expected)) < 0.1 * np.std(expected) + 0.05, name


@pytest.mark.nightly
def test_every_source_that_is_known_has_a_sample(tmp_path, truth):
    told = set()
    for name, sample in SAMPLES.items():
        (tmp_path / name).mkdir()
        told |= {note for note in read_log(written(sample(truth), tmp_path / name)).raw.notes if "axes: " in note}
    assert {note.partition("axes: ")[2] for note in told} == {dialect.name for dialect in dialects()}


@pytest.mark.parametrize("name", by_day(SAMPLES, 17))
def test_a_known_source_is_read_as_it_is_documented(tmp_path, truth, name):
    channels = OF.get(name, (*GYROS, *ATTITUDE))
    check(gb.open_log(written(SAMPLES[name](truth), tmp_path)), truth, channels)
