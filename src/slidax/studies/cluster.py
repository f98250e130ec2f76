"""A pool that computes the rows of a study on a Dask cluster, whose workers may join and leave."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from slidax.core.errors import DefinitionError, plain_name
from slidax.core.files import MEGABYTE, read_bytes

from .cases import Columns, StudyTask, Values
from .runner import AbstractPool

if TYPE_CHECKING:
    from distributed import Client

VERSION = metadata.version("slidax")
"""Version of slidax in this process."""

ADDRESS = "DASK_SCHEDULER_ADDRESS"
"""Environment variable of Dask with the scheduler's address."""

AHEAD = 2
"""Chunks submitted per worker, so that no worker waits for the next."""

TRIES = 100
"""Largest number of retries for a chunk that raised an error, and for one whose workers died."""

PATIENCE = 30.0
"""Time limit for a scheduler to answer [s]."""

LOOKS = 5.0
"""Interval between checks that local workers are alive [s]."""


def _address(where: str) -> str:
    """Return the address of a scheduler: from the environment for `env`, from a file NAME.json, or the text itself."""
    if where == "env":
        if ADDRESS not in os.environ:
            raise DefinitionError(
                f"`--cluster env` reads the scheduler's address from {ADDRESS}, which is not set: set it"
            )
        return os.environ[ADDRESS]
    if not where.endswith(".json"):
        return where
    content = read_bytes(Path(where), "the scheduler file", most=MEGABYTE)
    try:
        return str(json.loads(content)["address"])
    except (ValueError, TypeError, KeyError):
        raise DefinitionError(
            f"the scheduler file `{where}` has no `address`; `dask scheduler --scheduler-file {where}` writes one"
        ) from None


class Cluster(AbstractPool):
    """Dask workers, each of which computes whole chunks; the results do not depend on the worker, bit for bit.

    - `where`: `local:2` for two local processes, or the address of a scheduler, such as `tcp://10.0.0.1:8786`, whose
      workers must have slidax and the files that the scenario names. Instead of the address, `where` may be a scheduler
      file, such as `scheduler.json`, or `env` for the address in the environment variable DASK_SCHEDULER_ADDRESS. A
      `distributed.Client` of your own is used as it is, and stays open.

    Raises DefinitionError if Dask is not installed, `where` is invalid, or no scheduler answers.
    """

    def __init__(self, where: str | Client) -> None:
        try:
            import distributed
        except ImportError:
            raise DefinitionError(
                "a cluster needs Dask, which is not installed: pip install 'slidax[cluster]'"
            ) from None
        self._dask: Any = distributed
        self._local: Any = None
        self._ready = where if isinstance(where, distributed.Client) else None
        if isinstance(where, distributed.Client):
            if where.asynchronous:
                raise DefinitionError("`Cluster` needs a blocking client: make it with `Client(asynchronous=False)`")
            return
        where = _address(where)
        kind, _, rest = where.partition(":")
        if kind == "local":
            if not (rest.isascii() and rest.isdigit()) or not 1 <= int(rest) <= 4096:
                raise DefinitionError(
                    f"`--cluster` must be `local:` and a number of processes from 1 to 4096, such as `local:2`; got "
                    f"`{plain_name(where)}`"
                )
            self._local = int(rest)
        elif "://" not in where:
            raise DefinitionError(
                f"`--cluster` must be `local:2`, an address such as `tcp://10.0.0.1:8786`, a scheduler file "
                f"(scheduler.json) or `env`; got `{plain_name(where)}`"
            )
        self._where = where

    def __enter__(self) -> Cluster:
        dask = self._dask
        self._client: Any = self._ready
        if self._ready is not None:
            return self
        if self._local is not None:
            self._cluster = dask.LocalCluster(
                n_workers=self._local,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                host="127.0.0.1",
                silence_logs=50,
            )
            self._client = dask.Client(self._cluster)
            self._over = threading.Event()
            self._watch = threading.Thread(target=self._replace_the_dead, daemon=True)
            self._watch.start()
        else:
            try:
                self._client = dask.Client(self._where, timeout=PATIENCE)
            except (OSError, TimeoutError) as error:
                raise DefinitionError(f"no Dask scheduler answers at `{plain_name(self._where)}`: {error}") from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._local is not None:
            self._over.set()
            self._watch.join()
        if self._ready is None:
            self._client.close()
        if self._local is not None:
            self._cluster.close()

    def _replace_the_dead(self) -> None:
        """Replace workers that died while starting; Dask itself replaces only those that die at work."""
        dead: set[Any] = set()
        while not self._over.wait(LOOKS):
            workers = self._cluster.workers
            points = {name: nanny for name, nanny in list(workers.items()) if not nanny.is_alive()}
            # Dead at two checks in a row: Dask is not about to restart it.
            for name in dead & points.keys():
                workers.pop(name, None)
                self._cluster.sync(points[name].close)
            dead = set(points)
            self._cluster.scale(self._local)

    def each(self, task: StudyTask, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Values, Columns]]:
        """Yield first row number, values and results of each chunk, in the order in which workers finish.

        - `task`: family of scenarios to which the rows belong.
        - `chunks`: for each chunk, the number of its first row, and the values of its rows.

        Raises DefinitionError if a chunk's workers died too often, or a worker has another version of slidax.
        """
        pending: dict[Any, tuple[int, Values, int]] = {}
        ready = self._dask.as_completed(loop=self._client.loop)

        def submit(first: int, values: Values, tries: int) -> None:
            future = self._client.submit(compute_chunk, task.text, dict(values), VERSION, pure=False, retries=TRIES)
            pending[future] = first, values, tries
            ready.add(future)

        def submit_more() -> None:
            workers = max(len(self._client.scheduler_info(n_workers=-1)["workers"]), 1)
            while len(pending) < AHEAD * workers and (chunk := next(chunks, None)) is not None:
                submit(*chunk, tries=0)

        submit_more()
        while pending:
            future = next(ready)
            first, values, tries = pending.pop(future)
            try:
                columns = future.result()
            except self._dask.KilledWorker:
                if tries >= TRIES:
                    raise DefinitionError(
                        f"the workers that computed the rows from {first} on died {tries} times: give them more memory"
                    ) from None
                submit(first, values, tries + 1)
                continue
            yield first, values, columns
            submit_more()


def compute_chunk(text: str, values: Values, version: str) -> Columns:
    """Simulate the rows of a chunk on a worker, with all of its threads, and return their outcomes and metrics.

    - `text`: text of a `StudyTask`.
    - `values`: values of the rows.
    - `version`: version of slidax in the process that collects the rows.

    Raises DefinitionError if the worker has another version, whose rows may differ.
    """
    from distributed import get_worker

    if version != VERSION:
        raise DefinitionError(
            f"the worker {get_worker().address} has slidax {VERSION}, and this study slidax {version}: "
            f"install slidax {version} there, or stop this worker"
        )
    return StudyTask(text).run({path: np.asarray(array) for path, array in values.items()}, get_worker().state.nthreads)
