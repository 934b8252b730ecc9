"""Logging: text for people, or JSON for collectors; and what the log says about each plan."""

from __future__ import annotations

import json
import logging
from typing import TYPE_CHECKING

from contextpolicy.policy.quantities import format_cpu

if TYPE_CHECKING:
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Policy

log = logging.getLogger(__name__)


def log_plan(policy: Policy, plan: Plan) -> None:
    """One line for each plan that is carried out; with LOG_FORMAT=json its parts are fields."""
    shares = {name: format_cpu(task.share) for name, task in plan.tasks.items()}
    log.info(
        "%s: plan %d: %s -> %s",
        policy.reference,
        plan.sequence,
        plan.cause,
        " ".join(f"{name}={share}" for name, share in shares.items()),
        extra={
            "policy": policy.reference,
            "sequence": plan.sequence,
            "cause": plan.cause,
            "contexts": list(plan.contexts),
            "shares": shares,
        },
    )


def configure(log_format: str, level: str) -> None:
    """Log to stderr from now on, where kopf does not set it up; `log_format` is text or json."""
    handler = logging.StreamHandler()
    formatter = _Json() if log_format == "json" else logging.Formatter("[%(asctime)s] %(levelname)s %(message)s")
    handler.setFormatter(formatter)
    logging.basicConfig(level=level.upper(), handlers=[handler])


class _Json(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """One object per line."""
        line = {"timestamp": self.formatTime(record), "severity": record.levelname, "message": record.getMessage()}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line)
