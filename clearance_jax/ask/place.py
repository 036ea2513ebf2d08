"""Where lanes are solved: here, or on the workers of a dask cluster."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

from clearance_jax.errors import ClearanceError, quote
from clearance_jax.extras import missing_extra
from clearance_jax.solve.batch import cores_here

# As a cluster: workers on this machine, for a trial.
LOCAL = "local"
# How long a scheduler may take to answer.
PATIENCE = "10s"


class SolvePlace(NamedTuple):
    """Where lanes are solved: here, or by a dask `client`; on so many `cores` (`None`: all here, one a worker)."""

    client: Any = None
    cores: int | None = None


HERE = SolvePlace()


@contextmanager
def client_of(cluster: Any, cores: int = 1) -> Iterator[Any]:
    """A client of a cluster; what is made here is closed at the end. `LOCAL`: workers on this machine, of so many cores
    each. **Raises** `ClearanceError` for a scheduler that cannot be reached.
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
            # Nobody need hear that a worker took its time to end.
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
    """The place that is meant by a cluster: a dask client, the address of a scheduler, or "local"; `None`: here."""
    if cluster is None:
        yield SolvePlace(None, cores)
        return
    with client_of(cluster, cores or 1) as client:
        yield SolvePlace(client, cores)


def workers_of(client: Any) -> dict[str, Any]:
    """The workers of a client by their addresses."""
    return client.scheduler_info(n_workers=-1)["workers"]
