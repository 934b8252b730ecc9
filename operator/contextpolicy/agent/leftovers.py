"""Undo what a killed agent left, as an agent started in its place would if its grace period passed without a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reactivex.scheduler import VirtualTimeScheduler

from contextpolicy.agent.agent import Agent
from contextpolicy.agent.inotify import WriteWatch

if TYPE_CHECKING:
    from pathlib import Path

    from contextpolicy.agent.agent_settings import AgentSettings


def undo(settings: AgentSettings) -> None:
    """Undo it now, for every policy; what can't be undone stays in the journal. The caller holds the lock."""
    time = VirtualTimeScheduler()
    Agent(settings, time, _Blind()).start()
    time.start()


class _Blind(WriteWatch):
    """Watches nothing: what is undone once needs no watch, and the node may have none left to give."""

    def __init__(self) -> None:
        """Take nothing from the kernel."""

    def add(self, path: Path) -> None:
        """Ignore it."""

    def remove(self, path: Path) -> None:
        """Ignore it."""
