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

TEXT = "[%(asctime)s] %(levelname)s %(name)s: %(message)s"
"""A line of the log of operator and agent. kopf's own format cuts the logger's name after 20 characters."""

FIELDS = "fields"
"""The attribute of a record with what LOG_FORMAT=json adds to its object."""


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
            FIELDS: {
                "policy": policy.reference,
                "sequence": plan.sequence,
                "cause": plan.cause,
                "contexts": list(plan.contexts),
                "shares": shares,
            }
        },
    )


def configure(log_format: str, level: str) -> None:
    """Log to stderr from now on; `log_format` is text or json, with one line or one object for each record."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Json() if log_format == "json" else _Text(TEXT))
    logging.basicConfig(level=level.upper(), handlers=[handler])


class _Text(logging.Formatter):
    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - the base class's name
        """One line without control characters, whatever a policy or a sample says: it can't pass for another record."""
        line = super().formatMessage(record)
        return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(line.split()))


class _Json(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """One object per line."""
        line = {"timestamp": self.formatTime(record), "severity": record.levelname, "logger": record.name}
        line |= {"message": record.getMessage(), **getattr(record, FIELDS, {})}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line)
