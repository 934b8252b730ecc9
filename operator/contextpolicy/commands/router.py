"""`contextpolicy router`: a Zenoh router for the robot."""

from __future__ import annotations

import socket
import sys
from typing import TYPE_CHECKING

from contextpolicy.commands.credentials import add_credentials
from contextpolicy.commands.termination import stop_on_signals

if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    import zenoh

LOOK = 20.0
"""Seconds between two checks of our certificate. That is soon enough: a kubelet takes up to a minute to update a
Secret's files, and certificates are renewed days before they expire."""

NO_CERTIFICATE = """router: --uplink and --fleet need --credentials with ca.crt, tls.crt and tls.key, and no users.txt:
without certificates each robot's samples and plans would go to all others."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "router",
        help="run a Zenoh router",
        description="Route between Zenoh clients until SIGTERM. With --credentials clients must have a certificate (or "
        "a password, where the directory holds users.txt), and may say and hear what their role may: sensor, module, "
        "operator, agent or viewer, the common name of the certificate or the user's name. Many robots: each robot's "
        "router joins a fleet's router with --uplink, where viewers see what all of them decide; nothing goes from "
        "robot to robot.",
    )
    parser.add_argument(
        "--listen",
        default="tcp/*:7447",
        type=endpoints,
        metavar="ENDPOINTS",
        help="comma separated; the host * is every address of this machine, of IPv4 and IPv6 (default: %(default)s)",
    )
    add_credentials(parser)
    parser.add_argument(
        "--samples",
        default="**",
        metavar="KEYS",
        help="key expressions on which sensors and modules may publish, comma separated (default: %(default)s)",
    )
    place = parser.add_mutually_exclusive_group()
    place.add_argument(
        "--uplink",
        default=[],
        type=endpoints,
        metavar="ENDPOINTS",
        help="a fleet's router to join, several endpoints for the same one comma separated (default: none)",
    )
    place.add_argument(
        "--fleet", action="store_true", help="be the router that robots' routers join; its common name must be viewer"
    )
    parser.add_argument(
        "--metrics-port", type=int, metavar="PORT", help="serve /metrics for Prometheus here (default: no)"
    )
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Route until SIGTERM or SIGINT; open a new listener when the certificate was replaced.

    Zenoh reads a listener's files only once. Clients reconnect within a second or so; agents then ask for the plans in
    force.
    """
    if (arguments.uplink or arguments.fleet) and not _has_certificate(arguments.credentials):
        print(NO_CERTIFICATE, file=sys.stderr)
        return 2
    if arguments.metrics_port:
        _serve_metrics(arguments.metrics_port)
    stop = stop_on_signals()
    while not stop.is_set():
        files = _files(arguments.credentials)
        with _open(arguments) as session:
            _count_clients(session)
            print(f"routing at {','.join(arguments.listen)}", flush=True)
            while not stop.wait(LOOK if arguments.credentials else None) and _files(arguments.credentials) == files:
                pass
            _count_clients(None)
    return 0


def _open(arguments: argparse.Namespace) -> zenoh.Session:
    from contextpolicy.bus.session import open_fleet_router, open_router

    if arguments.fleet:
        return open_fleet_router(arguments.listen, arguments.credentials)
    samples = arguments.samples.split(",")
    return open_router(arguments.listen, arguments.credentials, samples, uplink=arguments.uplink)


def _has_certificate(directory: Path | None) -> bool:
    from contextpolicy.bus.credentials import CERTIFICATE, USERS

    return directory is not None and (directory / CERTIFICATE).is_file() and not (directory / USERS).is_file()


def endpoints(text: str) -> list[str]:
    """Read endpoints; the host `*` becomes every address of this machine."""
    # A kernel can be booted without IPv6; then there is no [::] to listen on.
    everywhere = "[::]" if socket.has_dualstack_ipv6() else "0.0.0.0"  # noqa: S104 - a router is there to be reached
    return [endpoint.replace("/*:", f"/{everywhere}:") for endpoint in text.split(",")]


def _serve_metrics(port: int) -> None:
    import prometheus_client

    from contextpolicy.telemetry.build_info import tell_build

    tell_build("router")
    prometheus_client.start_http_server(port)


def _count_clients(session: zenoh.Session | None) -> None:
    """Have a scrape ask the session; None while there is none."""
    from contextpolicy.telemetry.router_metrics import CLIENTS

    CLIENTS.set_function(lambda: len(session.info.transports()) if session else 0)


def _files(directory: Path | None) -> dict[str, bytes]:
    """The directory's files by name; a kubelet replaces all files of a Secret at once, so they belong together."""
    return {path.name: path.read_bytes() for path in sorted(directory.iterdir()) if path.is_file()} if directory else {}
