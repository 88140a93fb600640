"""A certificate authority for one car, and a certificate for each of its processes (X.509, ECDSA on P-256).

The common name of a certificate is the role of its process. RFC 5280; private keys: PKCS #8, readable by the owner.
"""

import ipaddress
import os
import re
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from trepid.config import InputError
from trepid.security import AUTHORITY, ROLE, certificate, private_key

try:
    from cryptography import x509
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError as error:
    raise InputError("keys need the library cryptography: pip install 'trepid[keys]'") from error

DAY = timedelta(days=1)
AUTHORITY_DAYS, PROCESS_DAYS = 3650, 825
LONGEST_NAME = 64  # bytes of a common name, ub-common-name of RFC 5280
LOOPBACK = ("127.0.0.1", "::1", "localhost")


def create(folder: Path, roles: Iterable[str], hosts: Iterable[str] = ()) -> list[Path]:
    """Make the authority and the keys of ``roles`` that are missing in ``folder``; the paths of the new files.

    ``hosts`` are names and addresses of machines of the car besides the loopback interface. Existing files are kept
    as they are. Raises InputError when one file of a pair is missing, an existing certificate is not for all
    ``hosts``, the authority is not valid today, or a file cannot be written.
    """
    for role in (roles := list(dict.fromkeys(roles))):
        if not re.fullmatch(ROLE, role) or role == AUTHORITY or len(role) > LONGEST_NAME:
            raise InputError(
                f"{role!r} cannot name a process: at most {LONGEST_NAME} letters, digits, '_', '-', '.', and not "
                f"{AUTHORITY}"
            )
    for host in (hosts := list(hosts)):
        _host(host)
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        return _create(folder, roles, hosts)
    except OSError as error:
        raise InputError(f"{error.filename or folder}: {error.strerror}") from error


def _create(folder: Path, roles: list[str], hosts: list[str]) -> list[Path]:
    missing = [role for role in roles if not _complete(folder, role)]
    _check_hosts(folder, [role for role in roles if role not in missing], hosts)
    if not missing:
        return []
    made: list[Path] = []
    now = datetime.now(UTC)
    if not certificate(folder, AUTHORITY).exists() and not private_key(folder, AUTHORITY).exists():
        key = ec.generate_private_key(ec.SECP256R1())
        name = _name(f"Trepid keys of {folder.resolve().name}")
        made += _write(folder, AUTHORITY, key, _sign(name, key, name, key, now + AUTHORITY_DAYS * DAY, None))
    authority = _authority(folder, now)
    until = min(now + PROCESS_DAYS * DAY, authority.not_valid_after_utc)
    signer = _read_key(folder, AUTHORITY)
    for role in missing:
        key = ec.generate_private_key(ec.SECP256R1())
        signed = _sign(_name(role), key, authority.subject, signer, until, [*LOOPBACK, *hosts])
        made += _write(folder, role, key, signed)
    return made


def _complete(folder: Path, role: str) -> bool:
    """Whether both files of ``role`` exist. Raises InputError when only one does."""
    pair = certificate(folder, role), private_key(folder, role)
    exist = [path.exists() for path in pair]
    if any(exist) and not all(exist):
        there, absent = (pair[0], pair[1]) if exist[0] else (pair[1], pair[0])
        raise InputError(
            f"{there}: {absent.name} beside it is missing; remove {there.name} to make both anew"
        )
    return all(exist)


def _check_hosts(folder: Path, roles: list[str], hosts: list[str]) -> None:
    """Raise InputError unless the certificates of ``roles`` are for all ``hosts``."""
    for host in hosts:
        short = [role for role in roles if not _is_for(_read_certificate(folder, role), host)]
        if short:
            files = ", ".join(f"{role}.crt" for role in short)
            raise InputError(
                f"{folder}: {files}: exist and are not for --host {host}; remove them and their .key files, "
                "and run the command again"
            )


def _is_for(own: Any, host: str) -> bool:
    """Whether the certificate ``own`` names ``host``, an address or the name of a machine."""
    try:
        names = own.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return False
    return _host(host.lower()).value in [
        entry.value.lower() if isinstance(entry, x509.DNSName) else entry.value for entry in names
    ]


def _name(common: str) -> Any:
    cut = common.encode(errors="replace")[:LONGEST_NAME].decode(errors="ignore")
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, cut)])


def _sign(name: Any, key: Any, issuer: Any, signer: Any, until: datetime, hosts: list[str] | None) -> Any:
    """A certificate for ``key``; of an authority when ``hosts`` is None."""
    now = datetime.now(UTC)
    is_authority = hosts is None
    usage = dict.fromkeys(
        (
            "content_commitment",
            "key_encipherment",
            "data_encipherment",
            "key_agreement",
            "encipher_only",
            "decipher_only",
        ),
        False,
    )
    builder = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - DAY)  # clocks of the machines of a car may differ
        .not_valid_after(until)
        .add_extension(x509.BasicConstraints(ca=is_authority, path_length=0 if is_authority else None), True)
        .add_extension(
            x509.KeyUsage(
                digital_signature=not is_authority, key_cert_sign=is_authority, crl_sign=is_authority, **usage
            ),
            True,
        )
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), False)
    )
    if hosts is not None:
        purposes = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        names = x509.SubjectAlternativeName([_host(host) for host in dict.fromkeys(hosts)])
        builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), False).add_extension(names, False)
    return builder.sign(signer, hashes.SHA256())


def _host(host: str) -> Any:
    """A name of a machine as an entry of a certificate. Raises InputError."""
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise InputError(f"--host {host}: neither an address nor the name of a machine") from error


def _write(folder: Path, role: str, key: Any, signed: Any) -> list[Path]:
    """Write key and certificate; fails when a file exists."""
    pem = serialization.Encoding.PEM
    secret = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    files = (
        (private_key(folder, role), secret, 0o600),
        (certificate(folder, role), signed.public_bytes(pem), 0o644),
    )
    for path, data, mode in files:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(data)
    return [path for path, _, _ in files]


def _read_certificate(folder: Path, role: str) -> Any:
    path = certificate(folder, role)
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no certificate can be read: {_line(error)}") from error


def _authority(folder: Path, now: datetime) -> Any:
    """The certificate of the authority. Raises InputError when it is not valid at ``now``."""
    found = _read_certificate(folder, AUTHORITY)
    again = f"remove all .key and .crt files in {folder} and run `trepid keys create {folder}`"
    _check_dates(certificate(folder, AUTHORITY), found, now, again)
    return found


def _check_dates(path: Path, found: Any, now: datetime, again: str) -> None:
    """Raise InputError unless the certificate ``found`` of ``path`` is valid at ``now``."""
    if now < found.not_valid_before_utc:
        raise InputError(
            f"{path}: is not valid before {found.not_valid_before_utc:%Y-%m-%d}, and this machine has "
            f"{now:%Y-%m-%d}: set its clock"
        )
    if now > found.not_valid_after_utc:
        raise InputError(f"{path}: expired on {found.not_valid_after_utc:%Y-%m-%d}; {again}")


def _read_key(folder: Path, role: str) -> Any:
    path = private_key(folder, role)
    try:
        return serialization.load_pem_private_key(path.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path}: no private key can be read: {_line(error)}") from error


def _line(error: Exception) -> str:
    return error.strerror or "" if isinstance(error, OSError) else str(error).splitlines()[0]


def check_certificate(
    folder: Path, role: str, now: datetime | None = None, *, host: str | None = None
) -> None:
    """Raise InputError unless certificate and key of ``role`` match, and the authority of ``folder`` signed it.

    ``host``: where the drive listens; the certificate has to name it, or no process connects to another.
    """
    now = now or datetime.now(UTC)
    path = certificate(folder, role)
    authority, own = _authority(folder, now), _read_certificate(folder, role)
    again = f"remove {role}.key and {role}.crt and run `trepid keys create {folder} --process {role}`"
    if _read_key(folder, role).public_key() != own.public_key():
        raise InputError(f"{path}: is not the certificate of {private_key(folder, role).name}; {again}")
    try:
        own.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise InputError(
            f"{path}: the authority {AUTHORITY}.crt beside it did not sign it; {again}"
        ) from error
    if [name.value for name in own.subject.get_attributes_for_oid(NameOID.COMMON_NAME)] != [role]:
        raise InputError(f"{path}: its common name is not {role}; {again}")
    _check_dates(path, own, now, again)
    if host is not None and not _is_for(own, host):
        raise InputError(
            f"{path}: is not for {host}, the host of `listen` in security.yaml; remove the .key and .crt of every "
            f"process, not those of {AUTHORITY}, and run `trepid keys create {folder} --host {host}`"
        )
