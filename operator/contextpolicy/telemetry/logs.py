"""Logging for the programs where kopf does not set it up: text for people, or JSON for collectors."""

from __future__ import annotations

import json
import logging


def configure(log_format: str, level: str) -> None:
    """Log to stderr from now on; `log_format` is text or json."""
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
