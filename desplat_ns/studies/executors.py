"""Runs that have no record yet are done and recorded: on this machine, or on a Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from desplat_ns.console import announce
from desplat_ns.errors import ConfigError, DeSplatError
from desplat_ns.files.lock import IN_USE
from desplat_ns.studies.machine import code_version, short
from desplat_ns.studies.records import FILE, Key, Record, load, save
from desplat_ns.studies.runs import Run, execute, surroundings

RUNS = "runs"
"""What is trained, in a command's output folder."""

RETRIES = 3
"""Times that a run is begun again on Ray if its worker was killed."""

ExecutorName = Literal["local", "ray"]
Do = Callable[[Run, Path], Record]
"""Does a run in a folder; see `execute`."""


@dataclass(frozen=True)
class Executor:
    """Where runs are done."""

    name: ExecutorName = "local"
    jobs: int = 1
    """Runs beside each other."""
    address: str | None = None
    """Of a Ray cluster; without one Ray is started here."""
    do: Do = execute

    def finish(
        self,
        runs: Iterable[Run],
        file: Path,
        folder: Path,
        done: Callable[[Run, Record], None] = lambda run, record: None,
    ) -> dict[str, str]:
        """Do all runs that have no record, and record each as it ends.

        Args:
            runs: the next is asked for when there is a place for it.
            file: of the records.
            folder: of what is trained.
            done: is told of each run once it is recorded.

        Returns:
            Why a run failed, by its name; that was said, too.

        Raises:
            ConfigError: records cannot be read or written, for instance because the disk is full.
            DeSplatError: Ray is not installed.
        """
        records, failed = load(file), dict[str, str]()
        coming = (run for run in runs if run.key not in records)
        pending: dict[Future[Record], Run] = {}
        folder.mkdir(parents=True, exist_ok=True)
        with self._places() as (places, do), ThreadPoolExecutor(places) as pool:
            while True:
                while len(pending) < places and (run := next(coming, None)) is not None:
                    pending[pool.submit(do, run, folder)] = run
                if not pending:
                    return failed
                for future in wait(pending, return_when=FIRST_COMPLETED).done:
                    run = pending.pop(future)
                    try:
                        records[run.key] = record = future.result()
                    except Exception as error:
                        kind = (
                            "" if isinstance(error, DeSplatError) else f"{type(error).__name__}: "
                        )
                        failed[run.name] = f"{kind}{error}"
                        announce(f"{run.name}: {failed[run.name]}", warning=True)
                    else:
                        save(file, records.values())
                        done(run, record)

    @contextmanager
    def _places(self) -> Iterator[tuple[int, Do]]:
        """How many runs are done beside each other, and what does one."""
        if self.name == "local":
            yield self.jobs, self.do
            return
        ray = _import_ray()
        here: dict[str, Any] = {"num_cpus": self.jobs, "include_dashboard": False}
        options = here if self.address is None else {"address": self.address}
        environment = {"env_vars": {"PYTHONPATH": surroundings()["PYTHONPATH"]}}
        ray.init(runtime_env=environment, log_to_driver=False, **options)
        try:
            resources = ray.cluster_resources()
            gpus, cores = (int(resources.get(name, 0)) for name in ("GPU", "CPU"))
            needs = {"num_cpus": 1, "num_gpus": min(1, gpus), "max_retries": RETRIES}
            task = ray.remote(**needs)(self.do)
            yield max(1, gpus or cores), lambda run, at: ray.get(task.remote(run, at.resolve()))
        finally:
            ray.shutdown()


def open_records(folder: Path) -> dict[Key, Record]:
    """The records in a command's output folder, which has a file of them from then on.

    Raises:
        ConfigError: the folder holds something else, or runs by other code.
    """
    there = folder.iterdir() if folder.is_dir() and not (folder / FILE).exists() else ()
    if any(path.name not in (IN_USE, RUNS) for path in there):
        raise ConfigError(
            f"--output is '{folder}', which holds something else. Name a new or empty folder."
        )
    records, code = load(folder / FILE), code_version()
    for other in {record.commit for record in records.values()} - {code}:
        raise ConfigError(
            f"'{folder}' holds runs by {short(other)}, and this is {short(code)}: their figures "
            "are not put together. Name another --output."
        )
    save(folder / FILE, records.values())
    return records


def _import_ray() -> Any:
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise DeSplatError(
            "--executor ray needs Ray, which is not installed. Type: pip install 'desplat-ns[ray]'."
        ) from error
    return ray
