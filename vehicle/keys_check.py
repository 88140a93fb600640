"""The check of the keys before a drive."""

from collections.abc import Iterable

from trepid.security import LAUNCHER, Security, check_private, load_security


def check_keys(roles: Iterable[str], security: Security | None = None) -> None:
    """Check the keys of the launcher and of all ``roles``; nothing without keys in the settings.

    Raises InputError for missing files, for private keys that others may read, and for certificates that are not
    those of their keys or of the authority, not valid today, or not for the host of ``listen``.
    """
    security = security or load_security()
    if security.folder is None:
        return
    from vehicle.certificates import check_certificate  # imports cryptography

    host = security.listen.rpartition(":")[0].strip("[]") if security.listen else None
    for role in (LAUNCHER, *roles):
        check_private(security.folder, role)
        check_certificate(security.folder, role, host=host)
