"""Cases on a Dask cluster of several machines.

Start one with ``dask scheduler``, and ``dask worker ADDRESS --nthreads 1`` for every core of every machine that has
Trepid (with ``--nworkers N`` for several at once). The scheduler moves the case of a lost worker to another
worker; a case that ended four workers has crashed. The files of the car in use are sent to the workers. Needs the
extra ``cluster``.
"""

import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar
from uuid import uuid4

from dask.config import set as configured
from distributed import Client, KilledWorker, WorkerPlugin, as_completed
from distributed.comm.addressing import parse_address, parse_host_port

from sim_harness.sweep.fingerprint import files_of_car, fingerprint, hash_of_files
from sim_harness.sweep.outcome import ClusterLost, Outcome, crash_outcome, execute
from sim_harness.sweep.plan import Plan
from trepid.config import InputError, car_folder, use_car

CONNECT_S = 10.0
WORKERS_S = 30.0  # until the first worker is connected
R = TypeVar("R")
_CARS: dict[str, "TemporaryDirectory[str]"] = {}
"""On a worker: the cars of the sweeps under way, by the name of their plug-in."""


def on_cluster(plan: Plan, address: str, *, detailed: bool = False) -> Iterator[tuple[str, Outcome]]:
    """Run the cases on the cluster at ``address``; outcomes come as they finish.

    Closing the iterator cancels the cases that have not started. Raises InputError when there is no cluster with
    the same versions, and ClusterLost.
    """
    with ExitStack() as stack:
        client = stack.enter_context(_connect(address))
        check_same_code(client, address)
        car = stack.enter_context(_car_on_workers(client))
        work = partial(in_car, car, partial(execute, detailed=detailed))
        futures = {client.submit(work, case, pure=False): key for key, case in plan.items()}
        for future in as_completed(list(futures), loop=client.loop):
            key = futures.pop(future)
            if future.status == "finished":
                outcome: Outcome = future.result()
                _check_code({outcome.code}, fingerprint(), address)  # a worker may have joined later
            elif isinstance(error := future.exception(timeout=CONNECT_S), KilledWorker):
                outcome = crash_outcome(
                    plan[key], f"crashed: it has killed {error.allowed_failures + 1} workers"
                )
            elif isinstance(error, InputError):
                raise error
            else:
                raise ClusterLost(f"--cluster {address}: lost with {len(futures) + 1} cases to run: {error}")
            future.release()
            yield key, outcome


class CarOnWorkers(WorkerPlugin):
    """Holds the files of a car on every worker, also on those that join later, until it is unregistered."""

    def __init__(self, car: Path) -> None:
        self.name = f"trepid-car-{uuid4().hex}"
        self._files = {path.relative_to(car).as_posix(): path.read_bytes() for path in files_of_car(car)}

    def setup(self, worker: object) -> None:
        """Write the files on a worker."""
        folder = _CARS[self.name] = TemporaryDirectory(prefix="trepid-car-")
        for name, data in self._files.items():
            path = Path(folder.name) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)

    def teardown(self, worker: object) -> None:
        """Remove the files."""
        _CARS.pop(self.name).cleanup()


@contextmanager
def _car_on_workers(client: Client) -> Iterator[str | None]:
    """The name under which :func:`in_car` finds the car in use on the workers; None without a car."""
    car = car_folder()
    if car is None:
        yield None
        return
    plugin = CarOnWorkers(car)
    client.register_plugin(plugin)
    try:
        yield plugin.name
    finally:
        with suppress(OSError):  # the cluster is lost
            client.unregister_worker_plugin(plugin.name)


def in_car(car: str | None, work: Callable[..., R], *arguments: object) -> R:
    """``work(*arguments)`` on a worker, with the car that was sent under the name ``car``; None: without a car."""
    use_car(None if car is None else Path(_CARS[car].name))
    return work(*arguments)


@contextmanager
def _connect(address: str) -> Iterator[Client]:
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
    """Raise InputError unless there are workers and all have the same code, defaults and versions."""
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
        found = client.run(hash_of_files, (), None)  # the car is sent later
        _check_code(set(found.values()), hash_of_files((), None), address)
    except ImportError as error:
        raise InputError(f"--cluster {address}: a worker has no Trepid: {error}") from error


def _check_code(fingerprints: set[str], ours: str, address: str) -> None:
    strange = fingerprints - {ours}
    if strange:
        raise InputError(
            f"--cluster {address}: a worker has other code, configuration or libraries ({strange.pop()}) than"
            f" this process ({ours}); install the same and restart it"
        )
