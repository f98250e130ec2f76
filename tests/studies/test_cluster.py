"""Chunks on a Dask cluster: the rows depend neither on the workers that compute them nor on killed workers."""

import json
import os
import signal
import threading
from typing import Any

import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.studies import RunOptions
from slidax.studies.cluster import Cluster
from tests.studies.files import ran, study
from tests.studies.test_store import assert_same_rows

pytest.importorskip("distributed", reason="Dask is not installed")

# A worker that was killed leaves sockets behind.
pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ("local", "a number of processes"),
        ("local:x", "got `local:x`"),
        ("local:0", "got `local:0`"),
        ("farm:8786", "tcp://"),
    ],
)
def test_an_invalid_cluster_address_is_refused_with_the_reason(where, words):
    with pytest.raises(DefinitionError, match=words):
        Cluster(where)


def test_a_scheduler_file_and_the_environment_name_the_scheduler(tmp_path, monkeypatch):
    import distributed

    how = {"n_workers": 0, "processes": False, "protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": None}
    with distributed.LocalCluster(**how) as farm:
        address = farm.scheduler_address
        (tmp_path / "scheduler.json").write_text(json.dumps({"address": address}))
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", address)
        for where in (str(tmp_path / "scheduler.json"), "env"):
            with Cluster(where) as pool:
                assert pool._client.scheduler_info()["address"] == address


def test_a_missing_scheduler_address_is_refused_with_the_reason(tmp_path, monkeypatch):
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)
    with pytest.raises(DefinitionError, match="from DASK_SCHEDULER_ADDRESS, which is not set"):
        Cluster("env")
    (tmp_path / "scheduler.json").write_text("{}")
    with pytest.raises(DefinitionError, match="has no `address`; `dask scheduler --scheduler-file"):
        Cluster(str(tmp_path / "scheduler.json"))


IN_PROCESS = {"processes": False, "dashboard_address": None, "threads_per_worker": 1, "n_workers": 1}


def test_a_users_dask_client_stays_open_after_use():
    import distributed

    with distributed.LocalCluster(**IN_PROCESS) as farm, distributed.Client(farm, set_as_default=False) as client:
        with Cluster(client) as pool:
            assert pool._client is client
        assert client.submit(abs, -1).result() == 1


@pytest.mark.full
def test_a_users_dask_client_computes_the_same_rows_as_a_single_process(tmp_path):
    import distributed

    ran(tmp_path / "here", runs=64)
    with (
        distributed.LocalCluster(**IN_PROCESS) as farm,
        distributed.Client(farm, set_as_default=False) as client,
        Cluster(client) as pool,
    ):
        study(runs=64).run(RunOptions(tmp_path / "there", pool=pool))
    assert_same_rows(tmp_path / "there", tmp_path / "here", 64)


def test_an_asynchronous_client_is_refused_with_its_remedy(monkeypatch):
    import distributed

    with distributed.LocalCluster(**IN_PROCESS) as farm, distributed.Client(farm, set_as_default=False) as client:
        monkeypatch.setattr(distributed.Client, "asynchronous", True)
        with pytest.raises(DefinitionError, match=r"blocking client: make it with `Client\(asynchronous=False\)`"):
            Cluster(client)
        monkeypatch.undo()


@pytest.mark.full
def test_a_scheduler_that_does_not_answer_is_reported(monkeypatch):
    monkeypatch.setattr("slidax.studies.cluster.PATIENCE", 1.0)
    with pytest.raises(DefinitionError, match="no Dask scheduler answers"), Cluster("tcp://127.0.0.1:1"):
        pass


class Workers:
    """A cluster of two, of which one died before Dask would start it anew."""

    class Nanny:
        def __init__(self, alive: bool) -> None:
            self.alive, self.closed = alive, False

        def is_alive(self) -> bool:
            return self.alive

        def close(self) -> None:
            self.closed = True

    def __init__(self, over: threading.Event) -> None:
        self.workers = {0: self.Nanny(True), 1: self.Nanny(False)}
        self.over, self.asked = over, 0

    def sync(self, work: Any) -> None:
        work()

    def scale(self, count: int) -> None:
        self.asked = count
        if len(self.workers) < count:
            self.over.set()


def test_a_worker_that_died_during_its_start_is_replaced(monkeypatch):
    monkeypatch.setattr("slidax.studies.cluster.LOOKS", 1e-3)
    pool = Cluster("local:2")
    pool._over = threading.Event()
    pool._cluster = Workers(pool._over)
    alive, dead = pool._cluster.workers.values()
    watch = threading.Thread(target=pool._replace_the_dead, daemon=True)
    watch.start()
    watch.join(10.0)
    assert not watch.is_alive() and pool._cluster.workers == {0: alive} and pool._cluster.asked == 2
    assert dead.closed and not alive.closed


def kill_workers(pool: Any, times: list[float], stop: threading.Event, killed: list[int]) -> None:
    """Kills one worker after each of these times, also one that is starting."""
    random = np.random.default_rng(0)
    for seconds in times:
        if stop.wait(seconds):
            return
        while not (workers := sorted(nanny.pid for nanny in list(pool._cluster.workers.values()) if nanny.pid)):
            if stop.wait(0.1):
                return
        pid = int(random.choice(workers))
        os.kill(pid, signal.SIGKILL)
        killed.append(pid)


@pytest.mark.full
@pytest.mark.parametrize("kills", [0, 20])
def test_killed_cluster_workers_change_no_row(kills, tmp_path, monkeypatch):
    for name in ("LEAST", "MOST"):
        monkeypatch.setattr(f"slidax.studies.runner.{name}", 64)
    changes = {"runs": 6400 if kills else 640, "changes": {"simulation.t1": 1}}
    ran(tmp_path / "here", **changes)
    stop, killed = threading.Event(), []
    times = np.random.default_rng(1).uniform(2.0, 8.0, kills).tolist()
    with Cluster("local:2") as pool:
        killer = threading.Thread(target=kill_workers, args=(pool, times, stop, killed))
        killer.start()
        try:
            again = 0
            # A study may end before all kills; then another study follows.
            while True:
                out = tmp_path / f"there{again}"
                study(**changes).run(RunOptions(out, pool=pool))
                assert_same_rows(out, tmp_path / "here", changes["runs"])
                again += 1
                if not killer.is_alive():
                    break
        finally:
            stop.set()
            killer.join()
    assert len(killed) == kills


def set_version():
    from slidax.studies import cluster

    cluster.VERSION = "0.0.7"


def test_a_worker_of_another_version_is_refused_by_its_address():
    with Cluster("local:1") as pool:
        pool._client.wait_for_workers(1)
        pool._client.run(set_version)
        with pytest.raises(DefinitionError, match=r"the worker tcp://127.0.0.1:\d+ has slidax 0.0.7, and this study"):
            study(runs=64).run(RunOptions(pool=pool))
