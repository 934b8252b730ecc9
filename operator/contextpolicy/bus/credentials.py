"""Who we are on the bus: the files of a Secret, in cert-manager's layout, as Zenoh's settings.

===========================  ==========================================================================================
file                         meaning
===========================  ==========================================================================================
ca.crt                       the authority that signs every client's and router's certificate
tls.crt, tls.key             our own certificate; its common name is our role (see `bus.roles`)
username, password           instead of a certificate, as in a Secret of type kubernetes.io/basic-auth
users.txt                    routers only: one `name:password` per line; clients then need a password, no certificate
===========================  ==========================================================================================

A client reads its certificate on each connect, so a renewed one needs no restart: the router closes a link when its
certificate expires, and the client reconnects. A listener never rereads its own, so the router has to be reopened
(`commands.router`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

CA, CERTIFICATE, KEY = "ca.crt", "tls.crt", "tls.key"
USER, PASSWORD, USERS = "username", "password", "users.txt"

_TLS = "transport/link/tls"


def client_settings(directory: Path | None) -> dict[str, object]:
    """Zenoh settings that authenticate a client; empty where the bus is open to all."""
    if directory is None:
        return {}
    settings: dict[str, object] = {f"{_TLS}/close_link_on_expiration": True}
    if (directory / CA).is_file():
        settings[f"{_TLS}/root_ca_certificate"] = str(directory / CA)
    if (directory / CERTIFICATE).is_file():
        settings[f"{_TLS}/enable_mtls"] = True
        settings[f"{_TLS}/connect_certificate"] = str(directory / CERTIFICATE)
        settings[f"{_TLS}/connect_private_key"] = str(directory / KEY)
    if (directory / USER).is_file():
        settings["transport/auth/usrpwd/user"] = _line(directory / USER)
        settings["transport/auth/usrpwd/password"] = _line(directory / PASSWORD)
    return settings


def router_settings(directory: Path) -> dict[str, object]:
    """Zenoh settings for a router that admits only authenticated clients."""
    settings: dict[str, object] = {
        f"{_TLS}/root_ca_certificate": str(directory / CA),
        f"{_TLS}/listen_certificate": str(directory / CERTIFICATE),
        f"{_TLS}/listen_private_key": str(directory / KEY),
        f"{_TLS}/enable_mtls": not (directory / USERS).is_file(),
        f"{_TLS}/close_link_on_expiration": True,
    }
    if (directory / USERS).is_file():
        settings["transport/auth/usrpwd/user"] = "router"
        settings["transport/auth/usrpwd/password"] = ""
        settings["transport/auth/usrpwd/dictionary_file"] = str(directory / USERS)
    return settings


def uplink_settings(directory: Path) -> dict[str, object]:
    """Zenoh settings for a router that joins another with its own certificate, now or as soon as that is there."""
    return {
        f"{_TLS}/connect_certificate": str(directory / CERTIFICATE),
        f"{_TLS}/connect_private_key": str(directory / KEY),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
    }


def _line(path: Path) -> str:
    return path.read_text(encoding="utf-8").rstrip("\n")
