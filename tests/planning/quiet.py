"""Who listens to a planner that is asked for its health, or of which nobody wants to know it."""

from __future__ import annotations


class Quiet:
    """Hears and does nothing."""

    def on_health(self) -> None:
        """Nothing."""
