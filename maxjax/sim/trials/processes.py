"""The processes of one job on one or many hosts: the share of each, and a wait until all are done (`jax.distributed`).

Slurm, Open MPI, Kubernetes and cloud TPUs tell JAX who a process is; elsewhere three variables do:

    JAX_COORDINATOR_ADDRESS   host:port of process 0       JAX_NUM_PROCESSES, JAX_PROCESS_ID   how many, and which

Flights need no other process: each flies on its own devices, and nothing is sent between them.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

import jax

from maxjax.sim.trials.shards import Shard

# Shares end hours apart, and who is done waits for the others [s].
_PATIENCE = 30 * 86400


@contextlib.contextmanager
def own_shard() -> Iterator[Shard]:
    """Join the processes of the job; the block flies the shard yielded, and is left when all have left theirs.

    To be called before JAX computes anything.

    Raises:
        ValueError: if the environment does not say that the process is one of many.
    """
    try:
        jax.distributed.initialize(
            num_processes=_number("JAX_NUM_PROCESSES"),
            process_id=_number("JAX_PROCESS_ID"),
            shutdown_timeout_seconds=_PATIENCE,
        )
    except ValueError as error:
        raise ValueError(
            f"--distributed: expected a job of Slurm, Kubernetes or Open MPI, or JAX_COORDINATOR_ADDRESS, "
            f"JAX_NUM_PROCESSES and JAX_PROCESS_ID; {error}"
        ) from error
    yield Shard(jax.process_index(), jax.process_count())
    jax.distributed.shutdown()


def _number(name: str) -> int | None:
    text = os.environ.get(name)
    if text is not None and not text.isdecimal():
        raise ValueError(f"{name}: expected a number, given {text!r}")
    return None if text is None else int(text)
