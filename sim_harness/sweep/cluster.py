"""Cases on a Dask cluster of several machines.

Start one with ``dask scheduler``, and ``dask worker ADDRESS --nthreads 1`` for every core of every machine that has
Trepid (with ``--nworkers N`` for several at once). The scheduler moves the case of a lost worker to another
worker; a case that ended four workers has crashed. Needs the extra ``cluster``.
"""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from dask.config import set as configured
from distributed import Client, KilledWorker, as_completed
from distributed.comm.addressing import parse_address, parse_host_port

from sim_harness.sweep.fingerprint import fingerprint
from sim_harness.sweep.outcome import ClusterLost, Outcome, crashed, execute
from sim_harness.sweep.plan import Plan
from trepid.config import InputError

CONNECT_S = 10.0
WORKERS_S = 30.0  # until the first worker is connected


def on_cluster(plan: Plan, address: str, *, detailed: bool = False) -> Iterator[tuple[str, Outcome]]:
    """Run the cases on the cluster at ``address``; outcomes come as they finish.

    Closing the iterator cancels the cases that have not started. Raises InputError when there is no cluster with
    the same versions, and ClusterLost.
    """
    with _connected(address) as client:
        check_same_code(client, address)
        work = partial(execute, detailed=detailed)
        futures = {client.submit(work, case, pure=False): key for key, case in plan.items()}
        for future in as_completed(list(futures), loop=client.loop):
            key = futures.pop(future)
            if future.status == "finished":
                outcome: Outcome = future.result()
                _check_code({outcome.code}, address)  # a worker may have joined later
            elif isinstance(error := future.exception(timeout=CONNECT_S), KilledWorker):
                outcome = crashed(plan[key], f"crashed: it has killed {error.allowed_failures + 1} workers")
            elif isinstance(error, InputError):
                raise error
            else:
                raise ClusterLost(f"--cluster {address}: lost with {len(futures) + 1} cases to run: {error}")
            future.release()
            yield key, outcome


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """A client that reports errors as InputError instead of in logs."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with warnings.catch_warnings(), configured({"distributed.comm.timeouts.connect": CONNECT_S}):
        warnings.simplefilter("ignore")  # about versions, which check_same_code checks
        try:
            parse_host_port(parse_address(address)[1])  # a client reports a bad address too late
            client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"--cluster {address}: no Dask scheduler answers there: {error}") from error
        with client:
            yield client


def check_same_code(client: Client, address: str) -> None:
    """Raise InputError unless there are workers and all have the same code, configuration and versions."""
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError as error:
        raise InputError(f"--cluster {address}: there is no worker") from error
    versions: Any = client.get_versions()
    ours = versions["client"]["packages"]
    for worker, found in versions["workers"].items():
        for name in ("python", "dask", "distributed"):
            theirs = found["packages"][name]
            if theirs != ours[name]:
                raise InputError(f"--cluster {address}: {worker} has {name} {theirs}, here is {ours[name]}")
    try:
        _check_code(set(client.run(fingerprint).values()), address)
    except ImportError as error:
        raise InputError(f"--cluster {address}: a worker has no Trepid: {error}") from error


def _check_code(fingerprints: set[str], address: str) -> None:
    strange = fingerprints - {fingerprint()}
    if strange:
        raise InputError(
            f"--cluster {address}: a worker has other code, configuration or libraries ({strange.pop()}) than"
            f" this process ({fingerprint()}); install the same and restart it"
        )
