"""The Zenoh endpoint at which the processes of a drive meet."""

from trepid.bus import free_endpoint
from trepid.config import CONFIG_DIR, InputError, located, read
from trepid.processes.page_door import listening
from trepid.security import drive_endpoint, refuse_open_endpoints


def usable_endpoint() -> str:
    """The endpoint of a drive of the car in use, at which nothing listens.

    Raises InputError with the place of ``listen`` when it may not, or cannot, be used.
    """
    endpoint = drive_endpoint(free_endpoint())
    if not endpoint.startswith("tls/"):
        try:
            refuse_open_endpoints({"listen/endpoints": [endpoint], "connect/endpoints": []})
        except InputError as error:
            raise _wrong_listen(str(error)) from error
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    try:
        listening(host.strip("[]"), int(port)).close()
    except OSError as error:
        what = f"{endpoint} cannot be used: {error.strerror}; give another HOST:PORT, or null for a free port"
        raise _wrong_listen(what) from error
    return endpoint


def _wrong_listen(what: str) -> InputError:
    file = CONFIG_DIR / "security.yaml"
    return InputError(located(("listen",), what, read(file), file))
