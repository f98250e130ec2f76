"""Chunks on a Dask cluster, whose workers may come and go."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, plain_name

from .cases import Columns, StudyTask, Values
from .runner import AbstractPool

AHEAD = 2
"""Chunks for each worker that are handed out at once, so that none waits for the next."""

TRIES = 100
"""A chunk whose worker died is handed out so often again."""

PATIENCE = 30.0
"""For a scheduler to answer [s]."""

LOOKS = 5.0
"""Between two looks at whether the workers here are alive [s]."""


class Cluster(AbstractPool):
    """Workers of Dask: each computes whole chunks, whose bits do not depend on which of them did.

    - `where`: `local:2` for two processes here, or the address of a scheduler, such as `tcp://10.0.0.1:8786`, whose
      workers must have slidax installed, and the files that the scenario names.

    Raises DefinitionError if Dask is not installed, or no scheduler answers.
    """

    def __init__(self, where: str) -> None:
        try:
            import distributed
        except ImportError:
            raise DefinitionError(
                "a cluster needs Dask, which is not installed: pip install 'slidax[cluster]'"
            ) from None
        self._dask: Any = distributed
        kind, _, rest = where.partition(":")
        self._local: Any = None
        if kind == "local":
            if not rest.isdigit() or not 1 <= int(rest) <= 4096:
                raise DefinitionError(
                    f"`--cluster` must be `local:` and a number of processes; got `{plain_name(where)}`"
                )
            self._local = int(rest)
        elif "://" not in where:
            raise DefinitionError(
                f"`--cluster` must be `local:2`, or an address such as `tcp://10.0.0.1:8786`; got `{plain_name(where)}`"
            )
        self._where = where

    def __enter__(self) -> Cluster:
        dask = self._dask
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
        self._client.close()
        if self._local is not None:
            self._cluster.close()

    def _replace_the_dead(self) -> None:
        """Dask starts a worker anew that dies at work, but not one that dies while it starts."""
        dead: set[Any] = set()
        while not self._over.wait(LOOKS):
            workers = self._cluster.workers
            points = {name: nanny for name, nanny in list(workers.items()) if not nanny.is_alive()}
            # Dead at two looks: nobody is about to start it.
            for name in dead & points.keys():
                workers.pop(name, None)
                self._cluster.sync(points[name].close)
            dead = set(points)
            self._cluster.scale(self._local)

    def each(self, task: StudyTask, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Values, Columns]]:
        """The rows of each chunk, as they become ready.

        - `task`: what they are of.
        - `chunks`: number of the first row, and values.

        Raises DefinitionError if a chunk's workers died again and again.
        """
        flying: dict[Any, tuple[int, Values, int]] = {}
        ready = self._dask.as_completed()

        def hand_out(first: int, values: Values, tries: int) -> None:
            future = self._client.submit(compute_chunk, task.text, dict(values), pure=False, retries=TRIES)
            flying[future] = first, values, tries
            ready.add(future)

        def more() -> None:
            workers = max(len(self._client.scheduler_info(n_workers=-1)["workers"]), 1)
            while len(flying) < AHEAD * workers and (chunk := next(chunks, None)) is not None:
                hand_out(*chunk, tries=0)

        more()
        while flying:
            future = next(ready)
            first, values, tries = flying.pop(future)
            try:
                columns = future.result()
            except self._dask.KilledWorker:
                if tries >= TRIES:
                    raise DefinitionError(
                        f"the workers that computed rows from {first} on died {tries} times: give them more memory"
                    ) from None
                hand_out(first, values, tries + 1)
                continue
            yield first, values, columns
            more()


def compute_chunk(text: str, values: Values) -> Columns:
    """The rows of a chunk, on a worker with as many threads as it has.

    - `text`: of the task.
    - `values`: by path, with the row first.
    """
    from distributed import get_worker

    return StudyTask(text).run({path: np.asarray(array) for path, array in values.items()}, get_worker().state.nthreads)
