"""Admission to a drive and permission to publish: settings of Zenoh for a process by its role (SECURITY.md).

Without keys all traffic stays on the loopback interface; an endpoint elsewhere is refused. With keys (``keys`` in
``security.yaml``, made by ``trepid keys create``) every link is TLS with a certificate on both sides. The common
name of a certificate is the role of its process, and every process drops what its sender may not publish.
"""

import ipaddress
import re
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from trepid.config import CONFIG_DIR, ROOT, InputError, Settings, car_folder, load

LAUNCHER = "launcher"
OBSERVER = "observer"
"""Roles outside processes.yaml: the launcher, and tools that attach to a drive and publish nothing."""
LAUNCHER_TOPICS = ("drive/losses",)
HEARTBEATS = ("diagnostics", "diagnostics/**")
"""What every process of a drive may publish besides its topics in ``processes.yaml``."""
AUTHORITY = "ca"
HIGHEST_PORT = 65535
LONGEST_LABEL = 63  # of a name of a host, between its dots
ROLE = r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$"


def _host_and_port(text: str) -> str:
    host, _, port = text.rpartition(":")
    fits = re.fullmatch(r"[^/?#]+:[0-9]{1,5}", text) and 0 < int(port) <= HIGHEST_PORT
    if not fits or not all(0 < len(label) <= LONGEST_LABEL for label in host.split(".")):
        raise ValueError(f"{text!r} is no HOST:PORT, such as 127.0.0.1:7447")
    return text


class Security(Settings):
    """``config/security.yaml``."""

    keys: Path | None
    listen: Annotated[str, AfterValidator(_host_and_port)] | None
    max_message_bytes: Annotated[int, Field(ge=65536)]

    @property
    def folder(self) -> Path | None:
        """The folder of the keys, relative to the folder of the car."""
        if self.keys is None:
            return None
        return (car_folder() or ROOT) / self.keys.expanduser()


def load_security() -> Security:
    """The settings of this car. Raises InputError."""
    return load(CONFIG_DIR / "security.yaml", Security)


def session_settings(
    role: str,
    *,
    publishes: Mapping[str, Sequence[str]] | None = None,
    connect: str | None = None,
    listen: str | None = None,
    security: Security | None = None,
) -> dict[str, Any]:
    """Values of the configuration of Zenoh, by key, for the process ``role``.

    ``publishes`` gives the topics of every process of the drive; all other messages are dropped on arrival. None,
    for observers: whatever a process with a certificate sends is received.
    ``connect`` and ``listen`` are the endpoints of :func:`trepid.bus.open_bus`; with keys both become TLS. Raises
    InputError for missing keys and for keys that others may read.
    """
    security = security or load_security()
    settings: dict[str, Any] = {"transport/link/rx/max_message_size": security.max_message_bytes}
    if security.folder is None:
        return settings
    check_private(security.folder, role)
    own = listen or f"tls/{_host(security)}:0"
    if publishes is not None:
        settings["access_control"] = access_control(publishes)
    return settings | {
        "listen/endpoints": [_over_tls(own)],
        "connect/endpoints": [_over_tls(connect)] if connect else [],
        "transport/link/protocols": ["tls"],
        "transport/link/tls": _tls(security.folder, role),
    }


def refuse_open_endpoints(settings: Mapping[str, Any]) -> None:
    """Raise InputError when ``settings`` of Zenoh leave the loopback interface without certificates."""
    mutual = settings.get("transport/link/tls", {}).get("enable_mtls", False)
    for endpoint in (*settings["listen/endpoints"], *settings["connect/endpoints"]):
        if not on_loopback(endpoint) and not (mutual and endpoint.startswith("tls/")):
            raise InputError(f"{endpoint}: leaves this machine without keys; {_REMEDY}")


_REMEDY = "`trepid keys create DIR` makes them, `keys: DIR` in security.yaml of the car uses them"


def drive_endpoint(free: str, security: Security | None = None) -> str:
    """The endpoint of a drive: ``listen`` of the settings, else ``free``, which is on loopback; TLS with keys."""
    security = security or load_security()
    endpoint = free if security.listen is None else f"tcp/{security.listen}"
    return endpoint if security.keys is None else _over_tls(endpoint)


def on_loopback(endpoint: str) -> bool:
    """True when only this machine reaches ``endpoint``, such as ``tcp/127.0.0.1:7447``."""
    protocol, _, address = endpoint.partition("/")
    if protocol.startswith("unix"):
        return True
    host = address.partition("#")[0].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _host(security: Security) -> str:
    return security.listen.rpartition(":")[0] if security.listen else "127.0.0.1"


def _over_tls(endpoint: str) -> str:
    return f"tls/{endpoint.partition('/')[2]}"


def certificate(folder: Path, role: str) -> Path:
    """Path of the certificate of ``role``."""
    return folder / f"{role}.crt"


def private_key(folder: Path, role: str) -> Path:
    """Path of the private key of ``role``."""
    return folder / f"{role}.key"


def check_private(folder: Path, role: str) -> None:
    """Raise InputError unless the files of ``role`` exist and its private key is readable by its owner alone.

    The private key of the authority may be elsewhere; in ``folder`` it too has to be readable by its owner alone.
    """
    key = private_key(folder, role)
    for path in (certificate(folder, AUTHORITY), certificate(folder, role), key):
        if not path.is_file():
            raise InputError(f"{path}: no such file; `trepid keys create {folder} --process {role}` makes it")
    for secret in (key, private_key(folder, AUTHORITY)):
        mode = stat.S_IMODE(secret.stat().st_mode) if secret.exists() else 0
        if mode & 0o077:
            raise InputError(
                f"{secret}: others may read this private key (mode {mode:04o}); run `chmod 600 {secret}`"
            )


def _tls(folder: Path, role: str) -> dict[str, Any]:
    """TLS with certificates on both sides."""
    own, key = str(certificate(folder, role)), str(private_key(folder, role))
    return {
        "root_ca_certificate": str(certificate(folder, AUTHORITY)),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": False,  # a certificate that expires while driving ends no link
        "listen_certificate": own,
        "listen_private_key": key,
        "connect_certificate": own,
        "connect_private_key": key,
    }


def access_control(publishes: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Access control of Zenoh, its setting ``access_control``: a message that no rule permits is refused.

    ``publishes``: keys below ``trepid/<vehicle-name>/`` by role. Every process gets the same rules and applies them
    to what arrives, so that none depends on another.
    """
    rules = [
        _rule("out", ["put", "declare_subscriber", *_LIVELINESS], "egress", ["**"]),
        _rule("subscribe", ["declare_subscriber", *_LIVELINESS], "ingress", ["trepid/**"]),
    ]
    subjects: list[dict[str, Any]] = [{"id": "all"}]
    policies: list[dict[str, Any]] = [{"rules": ["out"], "subjects": ["all"]}]
    for role, topics in {LAUNCHER: LAUNCHER_TOPICS, **publishes}.items():
        keys = [f"trepid/*/{key}" for key in (*topics, *HEARTBEATS)]
        rules.append(_rule(f"publish-{role}", ["put"], "ingress", keys))
        subjects.append({"id": f"process-{role}", "cert_common_names": [role]})
        policies.append({"rules": ["subscribe", f"publish-{role}"], "subjects": [f"process-{role}"]})
    subjects.append({"id": OBSERVER, "cert_common_names": [OBSERVER]})
    policies.append({"rules": ["subscribe"], "subjects": [OBSERVER]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, messages: list[str], flow: str, keys: list[str]) -> dict[str, Any]:
    return {"id": name, "messages": messages, "flows": [flow], "permission": "allow", "key_exprs": keys}


_LIVELINESS = ["liveliness_token", "liveliness_query", "declare_liveliness_subscriber"]
