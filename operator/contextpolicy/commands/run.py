"""`contextpolicy run`: the operator, under kopf, with its health and metrics endpoints."""

from __future__ import annotations

import gc
import logging
import os
from typing import TYPE_CHECKING

from contextpolicy.commands.termination import stop_on_signals

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from contextpolicy.app.settings import Settings


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "run",
        help="run the operator",
        description="Run the operator: watch ContextPolicy objects and sensor streams, resize the tasks' pods. "
        "Settings come from the environment: ZENOH_CONNECT, ZENOH_CREDENTIALS, PLAN_SIGNING, WATCH_NAMESPACES, "
        "TENANTS, HEALTH_PORT, METRICS_PORT, LIVE_PORT (the live page, on the loopback), LEASE (namespace/name, for "
        "which replicas run), LEASE_SECONDS, LEASE_POD (name/UID of the pod with which it goes), "
        "IDENTITY, LOG_FORMAT, LOG_LEVEL.",
    )
    parser.set_defaults(main=main)


def main(_: argparse.Namespace) -> int:
    """Run until SIGTERM."""
    from contextpolicy.app import settings

    return run(settings.read(os.environ))


def run(settings: Settings) -> int:
    """Run the operator until SIGTERM or SIGINT; the exit code."""
    import kopf
    import prometheus_client
    from prometheus_client import REGISTRY

    from contextpolicy.app import probes
    from contextpolicy.app.supervisor import Supervisor, reach, restart_process
    from contextpolicy.live.page_server import PageServer
    from contextpolicy.telemetry import metrics
    from contextpolicy.telemetry.build_info import tell_build
    from contextpolicy.telemetry.scrape import Scrape

    formats = {"text": kopf.LogFormat.FULL, "json": kopf.LogFormat.JSON}
    kopf.configure(
        debug=settings.log_level == "debug",
        quiet=settings.log_level in ("warning", "error"),
        log_format=formats[settings.log_format],
    )
    logging.getLogger("kopf.objects").setLevel(logging.WARNING)
    stop = stop_on_signals()
    tell_build("operator")
    prometheus_client.start_http_server(settings.metrics_port)
    pages: dict[str, Callable[[], list[str]]] = {"/healthz": list, "/readyz": lambda: ["no API server answers yet"]}
    probes.serve(settings.health_port, pages)
    api = reach(stop, lambda method, code: metrics.API_REQUESTS.labels(method, code).inc())
    if api is None:
        return 0
    supervisor = Supervisor(api, settings, restart_process)
    pages |= {"/healthz": supervisor.hung, "/readyz": supervisor.unready}
    REGISTRY.register(Scrape(supervisor.operator.queries.scrape))
    live = PageServer(settings.live_port, supervisor.operator.queries)
    live.start()
    # A full collection takes tens of milliseconds, in which nobody decides, to find that all imports are still needed.
    gc.freeze()
    try:
        return supervisor.run(stop)
    finally:
        live.close()
