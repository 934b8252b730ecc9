"""Start kopf with our handlers, the health endpoint and the metrics endpoint."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import kopf
import prometheus_client

from contextpolicy import handlers

if TYPE_CHECKING:
    from contextpolicy.settings import Settings

_FORMATS = {"text": kopf.LogFormat.FULL, "json": kopf.LogFormat.JSON}


def run(settings: Settings) -> None:
    """Run the operator until it is told to stop."""
    kopf.configure(
        debug=settings.log_level == "debug",
        quiet=settings.log_level in ("warning", "error"),
        log_format=_FORMATS[settings.log_format],
    )
    for chatty in ("kopf.objects", "aiohttp.access"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
    prometheus_client.start_http_server(settings.metrics_port)
    kopf.run(
        registry=handlers.registry,
        standalone=True,
        clusterwide=not settings.namespaces,
        namespaces=settings.namespaces,
        liveness_endpoint=f"http://0.0.0.0:{settings.health_port}/healthz",
        memo=kopf.Memo(settings=settings),
    )
