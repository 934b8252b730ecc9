"""`contextpolicy router`: a Zenoh router for the robot."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from contextpolicy.bus.listening import EVERYWHERE
from contextpolicy.commands.bus_arguments import add_credentials
from contextpolicy.commands.termination import stop_on_signals

if TYPE_CHECKING:
    import threading
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
        "a password, where the directory holds users.txt), and may publish and receive what their role allows: "
        "sensor, module, operator, agent or viewer, the common name of the certificate or the user's name. In a fleet, "
        "each robot's router joins the fleet's router with --uplink, where viewers see what all robots decide; nothing "
        "passes from robot to robot.",
    )
    _add_clients(parser)
    _add_fleet(parser)
    _add_process(parser)
    parser.set_defaults(main=main)


def _add_clients(parser: argparse.ArgumentParser) -> None:
    """Where clients connect, who they may be, and what they may send."""
    parser.add_argument(
        "--listen",
        default="tcp/*:7447",
        type=endpoints,
        metavar="ENDPOINTS",
        help="endpoints to listen on, comma separated; the host * is every IPv4 and IPv6 address of this machine "
        "(default: %(default)s)",
    )
    add_credentials(parser)
    parser.add_argument(
        "--samples",
        default=[],
        type=sample_keys,
        metavar="KEYS",
        help="key expressions on which sensors and modules may publish, comma separated (default: all keys but "
        "contextpolicy/**)",
    )
    parser.add_argument(
        "--max-message-bytes",
        type=_positive,
        default=8 << 20,
        metavar="BYTES",
        help="drop larger messages; policies read payloads of up to 1 MiB, camera frames for modules may be larger "
        "(default: %(default)s)",
    )


def _add_fleet(parser: argparse.ArgumentParser) -> None:
    """The router's place in a fleet, if it has one."""
    place = parser.add_mutually_exclusive_group()
    place.add_argument(
        "--uplink",
        default=[],
        type=endpoints,
        metavar="ENDPOINTS",
        help="the fleet's router to join; several endpoints of the same router are comma separated (default: none)",
    )
    place.add_argument(
        "--fleet",
        action="store_true",
        help="be the router that robots' routers join; its certificate's common name must be viewer",
    )


def _add_process(parser: argparse.ArgumentParser) -> None:
    """How the process is watched, and started again."""
    parser.add_argument(
        "--metrics-port", type=int, metavar="PORT", help="serve /metrics for Prometheus on this port (default: none)"
    )
    parser.add_argument(
        "--supervised",
        action="store_true",
        help="route in a child process, and restart it at once if it is killed",
    )
    parser.add_argument("--restarts", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--ready-fd", type=int, help=argparse.SUPPRESS)


def main(arguments: argparse.Namespace) -> int:
    """Route, or supervise a child process that does."""
    return _supervise() if arguments.supervised else _route(arguments)


def _supervise() -> int:
    """The same command line, but for the option that means this process."""
    from contextpolicy.bus.router_supervisor import RouterSupervisor

    words = [word for word in sys.argv[1:] if word != "--supervised"]
    ready = os.eventfd(0, os.EFD_NONBLOCK)  # which the router inherits, and writes to as soon as it routes

    def start(restarts: int) -> int:
        command = [sys.executable, "-m", "contextpolicy", *words, f"--restarts={restarts}", f"--ready-fd={ready}"]
        return os.posix_spawn(command[0], command, os.environ)

    def routed() -> bool:
        with suppress(BlockingIOError):
            return os.eventfd_read(ready) > 0
        return False

    supervisor = RouterSupervisor(start, routed)
    stop_on_signals(supervisor.stop)
    return supervisor.run()


def _route(arguments: argparse.Namespace) -> int:
    """Route until SIGTERM or SIGINT; open a new listener when the certificate was replaced by one that works.

    Zenoh reads a listener's files only once. Clients reconnect within a second or so; agents then ask for the plans in
    force.
    """
    if (arguments.uplink or arguments.fleet) and not _has_certificate(arguments.credentials):
        print(NO_CERTIFICATE, file=sys.stderr)
        return 2
    if arguments.metrics_port:
        _serve_metrics(arguments)
    stop = stop_on_signals()
    while not stop.is_set():
        files = _files(arguments.credentials)
        with _open(arguments) as session:
            _count_clients(session)
            print(f"routing at {','.join(arguments.listen)}", flush=True)
            if arguments.ready_fd is not None:
                os.eventfd_write(arguments.ready_fd, 1)
            _await_renewal(arguments.credentials, files, stop)
            _count_clients(None)
    return 0


def _await_renewal(directory: Path | None, files: dict[str, bytes], stop: threading.Event) -> None:
    """Return when the files were replaced by others that work, or at `stop`; others that don't are reported once."""
    from datetime import UTC, datetime

    from contextpolicy.bus.replacement import flaw

    seen = files
    while not stop.wait(LOOK if directory else None):
        try:
            found = _files(directory)
        except OSError:  # they are being replaced at this moment
            continue
        if found not in (files, seen):
            problem = flaw(found, files, datetime.now(UTC))
            if not problem:
                return
            print(f"router: {directory}/{problem}; still using the previous files", file=sys.stderr, flush=True)
        seen = found


def _open(arguments: argparse.Namespace) -> zenoh.Session:
    from contextpolicy.bus.session import open_fleet_router, open_router

    if arguments.fleet:
        return open_fleet_router(arguments.listen, arguments.credentials)
    largest: int = arguments.max_message_bytes
    return open_router(
        arguments.listen, arguments.credentials, arguments.samples, uplink=arguments.uplink, largest=largest
    )


def _has_certificate(directory: Path | None) -> bool:
    from contextpolicy.bus.credentials import CERTIFICATE, USERS

    return directory is not None and (directory / CERTIFICATE).is_file() and not (directory / USERS).is_file()


def endpoints(text: str) -> list[str]:
    """Read endpoints; the host `*` becomes every address of this machine."""
    host = f"[{EVERYWHERE}]" if ":" in EVERYWHERE else EVERYWHERE
    return [endpoint.replace("/*:", f"/{host}:") for endpoint in text.split(",")]


def sample_keys(text: str) -> list[str]:
    """Read key expressions for samples; those that cover keys of operators and agents are refused."""
    import zenoh

    from contextpolicy.bus.roles import OWN

    keys = text.split(",")
    for key in keys:
        try:
            covers = zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(f"{OWN}/**"))
        except zenoh.ZError:
            raise argparse.ArgumentTypeError(
                f"invalid value {key!r}: expected a key expression such as robot/**"
            ) from None
        if covers:
            raise argparse.ArgumentTypeError(f"invalid value {key!r}: expected keys outside {OWN}/**, such as robot/**")
    return keys


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise ValueError(text)
    return number


def _serve_metrics(arguments: argparse.Namespace) -> None:
    from contextpolicy.telemetry.build_info import publish_build
    from contextpolicy.telemetry.certificate_metrics import publish_expiry
    from contextpolicy.telemetry.metrics_server import serve_metrics
    from contextpolicy.telemetry.router_metrics import RESTARTS

    publish_build("fleet-router" if arguments.fleet else "router")
    publish_expiry("router", arguments.credentials)
    RESTARTS.inc(arguments.restarts)
    serve_metrics(arguments.metrics_port)


def _count_clients(session: zenoh.Session | None) -> None:
    """Have a scrape query the session; None before it is open."""
    from contextpolicy.telemetry.router_metrics import CLIENTS

    CLIENTS.set_function(lambda: len(session.info.transports()) if session else 0)


def _files(directory: Path | None) -> dict[str, bytes]:
    """The directory's files by name; a kubelet replaces all files of a Secret at once, so they belong together."""
    return {path.name: path.read_bytes() for path in sorted(directory.iterdir()) if path.is_file()} if directory else {}
