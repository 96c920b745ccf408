"""Workers: of this machine, or those of a scheduler."""

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

__all__ = ["ClusterOptions", "open_cluster"]

_WORKERS_DIED = 10
"""So many workers may die at a drive before it counts as the cause (convention)."""

_STARTS = 3
"""So often it is tried to start the workers of this machine (convention)."""

_CONFIG = {
    "distributed.scheduler.allowed-failures": _WORKERS_DIED,
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
    """Who does the work.

    Attributes
    ----------
    workers : int or None
        Processes on this machine, of one thread each; a worker for each core by default.
    memory : str
        Most that each of them may take, such as ``"2GB"``; auto shares the machine's.
    scheduler : str or None
        Address of a Dask scheduler, whose workers are used instead.
    """

    workers: int | None = None
    memory: str = "auto"
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"expected 1 or more, got {self.workers}", field="workers")
        if self.workers is not None and self.scheduler is not None:
            raise InputError("expected --workers or --scheduler, not both", field="workers")


@contextmanager
def open_cluster(options: ClusterOptions) -> Iterator[Any]:
    """A ``distributed.Client`` whose workers have compiled kernels.

    Raises
    ------
    InputError
        Where nothing answers at the scheduler's address.
    MissingExtraError
        Where Dask is not installed.
    """
    dask = optional_import("dask", extra="dask", purpose="running a fleet")
    with ExitStack() as opened:
        opened.enter_context(dask.config.set(_CONFIG))
        distributed = optional_import("distributed", extra="dask", purpose="running a fleet")
        for talker in ("distributed", "tornado", "asyncio"):  # of what ends while it is used
            logging.getLogger(talker).setLevel(logging.CRITICAL)
        if options.scheduler is not None:
            try:
                client = distributed.Client(options.scheduler, timeout=10)
            except (OSError, ValueError) as error:
                raise InputError(
                    "no scheduler answers there", file=options.scheduler, field="--scheduler"
                ) from error
            opened.enter_context(client)
            _compile_on_machines(client)
        else:
            compile_kernels()
            with _deaf_to_ctrl_c():
                cluster = opened.enter_context(_local(distributed, options))
            client = opened.enter_context(distributed.Client(cluster))
        yield client


def _local(distributed: Any, options: ClusterOptions) -> Any:
    count = options.workers or _cores()
    for _ in range(_STARTS):
        try:
            return distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                memory_limit=options.memory,
                dashboard_address=None,
            )
        except ValueError as error:
            raise InputError(f"expected a size such as 2GB: {error}", field="--memory") from error
        except RuntimeError:  # a worker was killed while it started
            continue
    raise InputError(f"{count} workers could not be started", field="--workers")


def _cores() -> int:
    """Those that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Keep Ctrl-C from threads and processes that begin here, and from all that those begin.

    A terminal sends it to every process; it is for the one that leads, which ends the workers.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # whose start would open the ears of its thread again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _compile_on_machines(client: Any) -> None:
    """One worker of each machine compiles, before there is work for the others."""
    workers = client.scheduler_info(n_workers=-1)["workers"]
    by_host = {worker["host"]: address for address, worker in workers.items()}
    client.gather(
        [
            client.submit(compile_kernels, workers=[address], pure=False, key=f"kernels-{host}")
            for host, address in by_host.items()
        ]
    )
