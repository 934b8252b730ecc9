"""`contextpolicy run`: the operator, under kopf, with its health and metrics endpoints."""

from __future__ import annotations

import logging
import os
from typing import TYPE_CHECKING

from contextpolicy import settings

if TYPE_CHECKING:
    import argparse

    from contextpolicy.settings import Settings


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "run",
        help="run the operator",
        description="Run the operator: watch ContextPolicy objects and sensor streams, resize the tasks' pods. "
        "Settings come from the environment: ZENOH_CONNECT, ZENOH_CREDENTIALS, PLAN_SIGNING, WATCH_NAMESPACES, "
        "TENANTS, HEALTH_PORT, METRICS_PORT, LIVE_PORT (the live page, on the loopback), LOG_FORMAT, LOG_LEVEL.",
    )
    parser.set_defaults(main=main)


def main(_: argparse.Namespace) -> int:
    """Run until SIGTERM."""
    run(settings.read(os.environ))
    return 0


def run(settings: Settings) -> None:
    """Run the operator until SIGTERM."""
    import kopf
    import prometheus_client

    from contextpolicy import handlers
    from contextpolicy.telemetry.build_info import tell_build

    formats = {"text": kopf.LogFormat.FULL, "json": kopf.LogFormat.JSON}
    kopf.configure(
        debug=settings.log_level == "debug",
        quiet=settings.log_level in ("warning", "error"),
        log_format=formats[settings.log_format],
    )
    for chatty in ("kopf.objects", "aiohttp.access"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    tell_build("operator")
    prometheus_client.start_http_server(settings.metrics_port)
    kopf.run(
        registry=handlers.registry,
        standalone=True,
        clusterwide=not settings.namespaces,
        namespaces=settings.namespaces,
        liveness_endpoint=f"http://0.0.0.0:{settings.health_port}/healthz",
        memo=kopf.Memo(settings=settings),
    )
