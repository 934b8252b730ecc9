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
    from contextpolicy.app.supervisor import Supervisor


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "run",
        help="run the operator",
        description="Run the operator: watch ContextPolicy objects and sensor streams, resize the tasks' pods. "
        "Settings come from the environment: ZENOH_CONNECT, ZENOH_CREDENTIALS, PLAN_SIGNING, WATCH_NAMESPACES, "
        "TENANTS, HEALTH_PORT, METRICS_PORT, LIVE_PORT (the live page, on the loopback), LEASE (namespace/name of "
        "the Lease that replicas compete for), LEASE_SECONDS, LEASE_POD (name/UID of the pod that owns it), "
        "ORIGINALS_KEY (namespace/name of the Secret with the key that signs originals), "
        "AGENTS (everywhere: report a node with tasks that has no node agent), SETTLE_SECONDS (for how long a plan "
        "stays the same before the API follows a node agent), IDENTITY, LOG_FORMAT, LOG_LEVEL.",
    )
    parser.set_defaults(main=main)


def main(_: argparse.Namespace) -> int:
    """Run until SIGTERM."""
    from contextpolicy.app import settings

    return run(settings.read(os.environ))


def run(settings: Settings) -> int:
    """Run the operator until SIGTERM or SIGINT; the exit code."""
    from contextpolicy.actuators.resize.stored_originals import signatures_with
    from contextpolicy.app.supervisor import NewProcess, Supervisor, reach
    from contextpolicy.cluster.originals_key import obtain_key
    from contextpolicy.live.page_server import PageServer
    from contextpolicy.telemetry import logs, metrics

    logs.configure(settings.log_format, settings.log_level)
    logging.getLogger("kopf.objects").setLevel(logging.WARNING)
    stop = stop_on_signals()
    pages = _serve(settings)
    api = reach(stop, metrics.RequestCount())
    if api is None:
        return 0
    key = obtain_key(api, *settings.originals_key, wait=stop.wait) if settings.originals_key else None
    supervisor = Supervisor(api, settings, NewProcess(), signatures_with(key))
    pages |= {"/healthz": supervisor.hung, "/readyz": supervisor.unready}
    _publish(supervisor)
    live = PageServer(settings.live_port, supervisor.operator.queries)
    live.start()
    # A full collection takes tens of milliseconds, in which nobody decides, to find that all imports are still needed.
    gc.freeze()
    try:
        return supervisor.run(stop)
    finally:
        live.close()


def _serve(settings: Settings) -> dict[str, Callable[[], list[str]]]:
    """Serve metrics and probes. Returns the probes' pages, to be replaced once there is an operator to ask."""
    from contextpolicy.app import probes
    from contextpolicy.telemetry.build_info import publish_build
    from contextpolicy.telemetry.certificate_metrics import publish_expiry
    from contextpolicy.telemetry.liveness import READY
    from contextpolicy.telemetry.metrics_server import serve_metrics

    publish_build("operator")
    publish_expiry("operator", settings.credentials)
    serve_metrics(settings.metrics_port)
    pages: dict[str, Callable[[], list[str]]] = {"/healthz": list, "/readyz": lambda: ["no API server answers yet"]}
    READY.set_function(lambda: not pages["/readyz"]())
    probes.serve(settings.health_port, pages)
    return pages


def _publish(supervisor: Supervisor) -> None:
    """Add to the metrics what is read from the running operator."""
    from prometheus_client import REGISTRY

    from contextpolicy.telemetry.liveness import LoopDelays
    from contextpolicy.telemetry.scrape import Scrape

    REGISTRY.register(LoopDelays(supervisor.delays))
    REGISTRY.register(Scrape(supervisor.operator.queries.scrape))
