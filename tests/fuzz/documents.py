"""Good messages to be damaged."""

from __future__ import annotations

from typing import Any

REPORT: dict[str, Any] = {
    "missing": {"CFS": [], "Realtime": ["no kernel option"]},
    "unlimited": "",
    "processors": 4,
    "quotaPeriod": 0.1,
}
APPLIED: dict[str, Any] = {"container": "robot/slam-1/slam", "stage": "accepted", "cores": 0.99}
