"""Where the runs of a study are done: on this machine, or on a Ray cluster."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from threading import Event, Lock
from typing import Any, Literal, Protocol, runtime_checkable

from desplat_ns.errors import DeSplatError
from desplat_ns.studies.runs import Command, Record, Run, execute, surroundings

ExecutorName = Literal["local", "ray"]

RETRIES = 3
"""Times that a run is begun again on Ray if its worker was killed."""

ANSWERS_WITHIN = 10
"""Seconds."""

Keep = Callable[[Run, Record | Exception], bool]
"""Takes what became of a run as soon as it is known; whether it was measured."""


@runtime_checkable
class Executor(Protocol):
    """Does runs."""

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        """Do all runs and hand over what becomes of each; one that fails leaves the others.

        Args:
            runs: the next is asked for when there is a place for it, in this process.
            folder: of what is trained.

        Returns:
            What `keep` said of each.

        Raises:
            DeSplatError: runs cannot be done here at all.
        """
        ...


@dataclass(frozen=True)
class LocalExecutor:
    """On this machine, some beside each other."""

    jobs: int = 1

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        """See `Executor`."""
        coming, done, asking, over = iter(runs), list[bool](), Lock(), Event()

        def work() -> None:
            try:
                while not over.is_set():
                    with asking:
                        run = next(coming, None)
                    if run is None:
                        return
                    done.append(keep(run, outcome(run, folder)))
            except BaseException:  # nobody is to begin another run
                over.set()
                raise

        with ThreadPoolExecutor(self.jobs) as pool:
            workers = [pool.submit(work) for _ in range(self.jobs)]
            try:
                for worker in workers:
                    worker.result()
            finally:
                over.set()  # where this thread was interrupted
        return done


@dataclass(frozen=True)
class RayExecutor:
    """On a Ray cluster: one that is named, or one on this machine that is started and ended.

    Workers need this package, the photos and `folder` in the same places as this machine.
    """

    address: str | None = None
    jobs: int = 1
    """Workers of a cluster that is started here."""

    def do(self, runs: Iterable[Run], folder: Path, keep: Keep) -> list[bool]:
        """See `Executor`. A run whose worker was killed is begun again."""
        ray = import_ray()
        folder, coming = folder.resolve(), iter(runs)
        self._check_that_it_answers()
        ray.init(**self._cluster())
        try:
            resources = ray.cluster_resources()
            gpus = int(resources.get("GPU", 0))
            places = max(1, gpus or int(resources.get("CPU", 1)))
            task = ray.remote(num_cpus=1, num_gpus=min(1, gpus), max_retries=RETRIES)(
                _outcome_on_worker
            )
            pending: dict[Any, Run] = {}
            done = []
            while True:
                for run in islice(coming, places - len(pending)):
                    pending[task.remote(run, folder)] = run
                if not pending:
                    return done
                (ready, *_), _ = ray.wait(list(pending), num_returns=1)
                done.append(keep(pending.pop(ready), _fetched(ray, ready)))
        finally:
            ray.shutdown()

    def _check_that_it_answers(self) -> None:
        """Ray itself waits for minutes."""
        host, colon, port = (self.address or "").removeprefix("ray://").rpartition(":")
        if not colon:  # none, or a name of Ray's own such as auto
            return
        try:
            socket.create_connection((host, int(port)), timeout=ANSWERS_WITHIN).close()
        except (OSError, ValueError) as error:
            raise DeSplatError(
                f"No Ray cluster answers at --ray-address {self.address} ({error}). Start one with "
                "`ray start --head`, or leave the address out to use this machine."
            ) from error

    def _cluster(self) -> dict[str, Any]:
        """Arguments of `ray.init`."""
        environment = {"PYTHONPATH": surroundings()["PYTHONPATH"]}
        options = {"runtime_env": {"env_vars": environment}, "log_to_driver": False}
        if self.address is None:
            return options | {"num_cpus": self.jobs, "include_dashboard": False}
        return options | {"address": self.address}


def executor_of(name: ExecutorName, jobs: int, address: str | None) -> Executor:
    """The executor of a name."""
    return LocalExecutor(jobs) if name == "local" else RayExecutor(address, jobs)


def outcome(run: Run, folder: Path, command: Command | None = None) -> Record | Exception:
    """The record of a run, or why there is none; see `execute`."""
    try:
        return execute(run, folder, command)
    except Exception as error:
        return error


def import_ray() -> Any:
    """The module. Raises DeSplatError where it is not installed."""
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise DeSplatError(
            "--executor ray needs Ray, which is not installed. Type: pip install 'desplat-ns[ray]'."
        ) from error
    return ray


def _outcome_on_worker(run: Run, folder: Path) -> Record | Exception:
    """As `outcome`; the error says on which machine."""
    result = outcome(run, folder)
    if isinstance(result, Exception):
        return DeSplatError(f"On the Ray worker {socket.gethostname()}: {result}")
    return result


def _fetched(ray: Any, reference: Any) -> Record | Exception:
    """What a task gave back, or why it gave nothing."""
    try:
        return ray.get(reference)
    except ray.exceptions.RayError as error:
        return DeSplatError(f"Ray gave up on it ({type(error).__name__}): {error}")
