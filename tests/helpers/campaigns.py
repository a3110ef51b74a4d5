"""Campaigns of seconds, for the tests of campaigns."""

import gtmbench as gb
from gtmbench.study.campaign.conduct import conduct
from gtmbench.study.campaign.plan import load_campaign

TINY = """
title = "Of seconds"
duration_s = 20
excitation = "multisine"
severity_reference_s = [2, 10]

[operator]
identify_s = [2, 10]
causal_order = 5
noncausal_order = 5

[alarm]
window = 20
threshold_s = [10, 18]
watch_from_s = 2
healthy_records = 1

[axes]
seed = "1:8"

[[faults]]
kind = "jam"
channels = ["q", "r"]
onset_s = 12

[[faults]]
kind = "deadzone"
channels = ["p"]
onset_s = 12
half_width = ["50 % of rms", "100 % of rms"]
"""


def written(folder, text=TINY, name="tiny"):
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def loaded(folder, text=TINY, name="tiny"):
    return load_campaign(written(folder, text, name))


def table(folder, text=TINY, **how):
    """Return a campaign's rows, as pandas has them."""
    return conduct(loaded(folder, text), folder / "out", **how).read().to_pandas()


def results(folder):
    """Return all that a finished campaign leaves, but for its locks and times: by name, the bytes."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.name.startswith(".")}


def fails(task):
    raise gb.InputError(f"not {task}")


def asserts(task):
    raise AssertionError(task)
