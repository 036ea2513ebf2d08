"""Where lanes are solved: on this machine, or on the workers of a dask cluster."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

from clearance_jax._basis.extras import missing_extra
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.solve.batch import cores_here

# The name of a trial cluster: workers on this machine.
LOCAL = "local"
# Timeout of the connection to a scheduler.
PATIENCE = "10s"


class SolvePlace(NamedTuple):
    """Where lanes are solved: on a dask `client` (`None`: this machine), with `cores` cores (`None`: all of this
    machine, or one of each worker).
    """

    client: Any = None
    cores: int | None = None


HERE = SolvePlace()


@contextmanager
def client_of(cluster: Any, cores: int = 1) -> Iterator[Any]:
    """A dask client of a `cluster`: a client, the address of a scheduler, or `LOCAL` (workers on this machine with
    `cores` cores each). What is created here is closed at the end. **Raises** `ClearanceError` if no scheduler answers.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise missing_extra("A sweep on a cluster", "dask", "sweep") from None
    if isinstance(cluster, Client):
        yield cluster
        return
    if not isinstance(cluster, str):
        raise ClearanceError(f"`cluster` must be an address or a dask client, but it is {quote(cluster)}.")
    with ExitStack() as made:
        if cluster == LOCAL:
            workers = max(1, cores_here() // cores)
            # Warnings about workers that end slowly do not concern the user.
            how = {"threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": logging.ERROR}
            cluster = made.enter_context(LocalCluster(workers, **how))
        try:
            client = made.enter_context(Client(cluster, timeout=PATIENCE))
        except (OSError, TimeoutError, ValueError) as error:
            reason = str(error).split("\n")[0]
            raise ClearanceError(
                f"No scheduler answers at `{cluster}`: {reason}. Start it, or mend the address (`{LOCAL}`: workers on "
                "this machine)."
            ) from None
        yield client


@contextmanager
def place_of(cluster: Any, cores: int | None = None) -> Iterator[SolvePlace]:
    """The place of a cluster: a dask client, the address of a scheduler, or "local"; `None`: this machine."""
    if cluster is None:
        yield SolvePlace(None, cores)
        return
    with client_of(cluster, cores or 1) as client:
        yield SolvePlace(client, cores)


def workers_of(client: Any) -> dict[str, Any]:
    """The workers of a client by their addresses."""
    return client.scheduler_info(n_workers=-1)["workers"]
