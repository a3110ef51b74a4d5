"""The benchmark on a Dask cluster: workers fly and watch, one of them dies, and the same score files stand here."""

import signal

import pandas as pd
import pytest

from gtmbench.detectors.rivals.catalogue import RIVALS
from gtmbench.jobs.workers import Workers
from gtmbench.study.benchmark.definition import TEST
from gtmbench.study.benchmark.run import run_benchmark
from tests.helpers.clusters import Cluster
from tests.helpers.small_benchmark import tiny

pytest.importorskip("distributed", reason="no extra [scale]")


def scores(folder):
    files = sorted((folder / "entries/limits").rglob("*.parquet"))
    return {file.relative_to(folder): pd.read_parquet(file) for file in files}


@pytest.mark.nightly
def test_a_worker_that_is_killed_changes_no_score(tmp_path):
    definition, detectors = tiny(tmp_path), {"limits": RIVALS["limits"]}
    (tmp_path / "cluster").mkdir()
    cluster = Cluster(tmp_path / "cluster")

    def tell(step, done, _of):
        if step == "watch" and done == 2:
            cluster.workers[0].send_signal(signal.SIGKILL)

    try:
        there = Workers(scheduler=cluster.address)
        rows = run_benchmark(definition, TEST, tmp_path / "there", detectors=detectors, workers=there, progress=tell)
        assert cluster.workers[0].wait(10) == -signal.SIGKILL
    finally:
        cluster.end()
    here = run_benchmark(definition, TEST, tmp_path / "here", detectors=detectors, workers=Workers(processes=2))
    assert [(row.name, row.quickness, row.wrong) for row in rows] == [
        (row.name, row.quickness, row.wrong) for row in here
    ]
    ours, theirs = scores(tmp_path / "here"), scores(tmp_path / "there")
    assert ours.keys() == theirs.keys()
    for name, frame in ours.items():
        pd.testing.assert_frame_equal(frame, theirs[name])
