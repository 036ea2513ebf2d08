"""A sweep on several worker processes, one of which is killed while it works."""

import importlib
import os
import signal
import time
from collections import Counter
from typing import Any

import numpy as np
import pytest
import xarray as xr
from distributed import Client, LocalCluster
from places import refused
from sweeping import CLEARANCES, SCENE, same, small_regions, swept

import clearance_jax as cj
from clearance_jax.runs.journal import Journal


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    small_regions(monkeypatch)
    monkeypatch.setattr(importlib.import_module("clearance_jax.ask.answers"), "PATIENCE", "1s")


def wait_for(client, workers):
    """Until a cluster has just so many."""
    end = time.monotonic() + 60
    while len(client.scheduler_info(n_workers=-1)["workers"]) != workers:
        assert time.monotonic() < end
        time.sleep(0.05)


def times_written(path):
    """How often each region is in a store's journal."""
    return Counter(r["region"] for r in Journal(path / "journal.jsonl").records if "region" in r)


@pytest.mark.slow
def test_a_worker_dies_and_nothing_is_lost_or_twice(tmp_path):
    """Nor is anything solved again that it had solved; and what it takes is said before. The store then grows by values
    between the old ones, and workers that come late help.
    """
    path, plans, killed = tmp_path / "a.zarr", [], []
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as made:
        cluster: Any = made
        with Client(cluster) as client:

            def kill_one(progress):
                if not killed:
                    workers: Any = client.run(os.getpid)
                    killed.append(next(iter(workers.values())))
                    os.kill(killed[0], signal.SIGKILL)

            swept(path, cluster=client, plan=plans.append, progress=kill_one)
            assert plans[0].place.startswith("2 workers")
            assert plans[0].seconds > 0
        # By the scheduler's address, nothing is left to do.
        seen = []
        swept(path, cluster=cluster.scheduler_address, resume=True, progress=seen.append)
        assert killed
        assert times_written(path) == dict.fromkeys(range(8), 1)
        assert seen == []
        # One worker, and another once something is done.
        wider = np.union1d(CLEARANCES, (CLEARANCES[:16] + CLEARANCES[1:17]) / 2)
        cluster.scale(1)
        with Client(cluster) as client:
            wait_for(client, 1)

            def one_more(progress):
                seen.append(progress)
                if len(seen) == 1:
                    cluster.scale(2)
                    wait_for(client, 2)

            found = swept(path, wider, cluster=client, resume=True, progress=one_more)
    assert max(progress.new for progress in seen) <= 256
    assert times_written(path) == dict.fromkeys(range(12), 1)
    assert [one.name for one in tmp_path.iterdir()] == ["a.zarr"]
    same(found, swept(clearances=wider))
    assert {one.name for one in path.iterdir() if one.is_file()} == {"journal.jsonl", "writer.lock", "zarr.json"}


@pytest.mark.slow
def test_workers_here_run_failed_lanes_again(tmp_path):
    """As this process would."""
    path, axes = tmp_path / "a.zarr", {"wrist.radial_clearance": np.linspace(1e-4, 5e-4, 128)}

    def run(**options):
        return cj.sweep(
            cj.load(SCENE), axes, {"end": "piston.position"}, 5e-4, rtol=1e-6, solver="tsit5", max_steps=82, **options
        )

    def both(**options):
        return run(cores=1, again={"max_steps": 88}, **options)

    expected = both()
    assert 0 < expected.attrs["failed"] < np.sum(expected["again"])
    found = both(store=path, cluster="local")
    same(found, expected)
    assert found.attrs["failed"] == expected.attrs["failed"]
    assert times_written(path) == {0: 2, 1: 2}
    xr.testing.assert_identical(found, both(store=path, resume=True).load())
    assert times_written(path) == {0: 2, 1: 2}


def test_what_is_no_cluster_is_said(tmp_path):
    with refused("cluster", "tcp://127.0.0.1:1"):
        swept(tmp_path / "a.zarr", cluster="tcp://127.0.0.1:1")
    with refused("store"):
        swept(cluster="tcp://127.0.0.1:1")
    with refused("cluster", 3):
        swept(tmp_path / "a.zarr", cluster=3)
    assert list(tmp_path.iterdir()) == []
