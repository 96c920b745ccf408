"""Workers: processes of this machine, or workers of a scheduler."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any

from farpoint.errors import InputError, optional_import
from farpoint.fleet.kernels import compile_kernels

__all__ = ["Cluster", "ClusterOptions", "open_cluster"]

_WORKERS_DIED = 10
"""Number of workers that may die while running a drive before the drive has failed (convention)."""

_STARTS_IN_VAIN = 20
"""Number of failed starts of workers, without a running one, before the fleet gives up."""

_ENDED = ("closing", "closed", "failed")

_CONFIG = {
    "distributed.scheduler.allowed-failures": _WORKERS_DIED,
    # Long, because a worker may start slowly; `Cluster.look_after` replaces lost workers.
    "distributed.deploy.lost-worker-timeout": "1 hour",
    "distributed.nanny.pre-spawn-environ": {
        "MALLOC_TRIM_THRESHOLD_": 65536,
        **dict.fromkeys(
            ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), 1
        ),
    },
    "logging.distributed": "critical",
}


@dataclass(frozen=True, kw_only=True)
class ClusterOptions:
    """Workers on which the drives are run.

    Attributes
    ----------
    workers : int or None
        Number of worker processes on this machine, with one thread each; by default the number of
        cores.
    memory : str
        Memory limit of each worker, such as ``"2GB"``. The value auto divides the memory of the
        machine among the workers.
    scheduler : str or None
        Address of a Dask scheduler whose workers are used instead of workers on this machine.
    """

    workers: int | None = None
    memory: str = "auto"
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"expected 1 or more, got {self.workers}", field="workers")
        if self.workers is not None and self.scheduler is not None:
            raise InputError("expected --workers or --scheduler, not both", field="workers")


class Cluster:
    """Workers whose number is kept constant: ended workers are replaced.

    Parameters
    ----------
    client : distributed.Client
        Client for the tasks.
    local : distributed.LocalCluster, optional
        Cluster of local workers, if any.
    count : int
        Number of local workers.
    memory : str
        Memory limit of each worker.

    Attributes
    ----------
    deaths : str
        Error message of a drive during which several workers have died.
    """

    def __init__(
        self, client: Any, local: Any = None, count: int = 0, memory: str = "auto"
    ) -> None:
        self.client = client
        self.deaths = "worker after worker died at it: killed, or out of memory"
        if local is not None:
            self.deaths += f" (--memory {memory})"
        self._local, self._count = local, count
        self._in_vain = 0
        self.look_after()

    def look_after(self) -> None:
        """Replace workers that have ended. The caller should call this method regularly.

        Dask restarts a worker that is killed, but not a worker that is killed during its start.

        Raises
        ------
        InputError
            If workers repeatedly end while they start.
        """
        if self._local is None:
            return
        local = self._local
        ended = [name for name, one in list(local.workers.items()) if one.status.value in _ENDED]
        known = [name for name in ended if name in local.worker_spec]
        if local.scheduler_info["workers"]:
            self._in_vain = 0
        if known:
            self._in_vain += 1
            if self._in_vain > _STARTS_IN_VAIN:
                raise InputError(f"{self._count} could not be started", field="--workers")
            local.loop.add_callback(local.scale_down, known)
        elif not ended:  # otherwise Dask still has the names of the ended workers
            local.scale(self._count)


@contextmanager
def open_cluster(options: ClusterOptions) -> Iterator[Cluster]:
    """Context with workers for which the kernels are compiled.

    Raises
    ------
    InputError
        If no scheduler answers at the given address.
    MissingExtraError
        If Dask is not installed.
    """
    dask = optional_import("dask", extra="dask", purpose="running a fleet")
    with ExitStack() as opened:
        opened.enter_context(dask.config.set(_CONFIG))
        _check_size(dask, options.memory)
        distributed = optional_import("distributed", extra="dask", purpose="running a fleet")
        for logger_name in ("distributed", "tornado", "asyncio"):  # they log ended workers
            logging.getLogger(logger_name).setLevel(logging.CRITICAL)
        if options.scheduler is not None:
            try:
                client = distributed.Client(options.scheduler, timeout=10)
            except (OSError, ValueError) as error:
                raise InputError(
                    "no scheduler answers there", file=options.scheduler, field="--scheduler"
                ) from error
            opened.enter_context(client)
            _compile_on_machines(client)
            yield Cluster(client)
        else:
            with _ignoring_ctrl_c():
                local = opened.enter_context(_local(distributed, options))
            client = opened.enter_context(distributed.Client(local))
            cluster = Cluster(client, local, options.workers or _cores(), options.memory)
            compile_kernels()  # while the workers start
            yield cluster


def _check_size(dask: Any, memory: str) -> None:
    try:
        if memory != "auto":
            dask.utils.parse_bytes(memory)
    except ValueError as error:
        raise InputError(f"expected a size such as 2GB: {error}", field="--memory") from error


def _local(distributed: Any, options: ClusterOptions) -> Any:
    """A local cluster with its scheduler in this process, without workers."""
    return distributed.LocalCluster(
        n_workers=0,
        threads_per_worker=1,
        processes=True,
        memory_limit=options.memory,
        dashboard_address="127.0.0.1:0",
        scheduler_kwargs={"dashboard": False},
        silence_logs=logging.CRITICAL,
    )


def _cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _ignoring_ctrl_c() -> Iterator[None]:
    """Keep Ctrl-C from the threads and processes that start here, and from their children.

    A terminal sends Ctrl-C to every process. Only the leading process handles Ctrl-C, and this
    process ends the workers.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # its start would unblock SIGINT in this thread
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _compile_on_machines(client: Any) -> None:
    """Let one worker of each machine compile the kernels before any drive starts."""
    workers = client.scheduler_info(n_workers=-1)["workers"]
    by_host = {worker["host"]: address for address, worker in workers.items()}
    client.gather(
        [
            client.submit(compile_kernels, workers=[address], pure=False, key=f"kernels-{host}")
            for host, address in by_host.items()
        ]
    )
