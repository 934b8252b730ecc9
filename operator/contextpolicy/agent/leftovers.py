"""Undo what a killed agent left, as an agent started in its place would at its own end: no source of plans is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reactivex.scheduler import VirtualTimeScheduler

from contextpolicy.agent.agent import Agent
from contextpolicy.agent.open_files import Unwatched

if TYPE_CHECKING:
    from contextpolicy.agent.agent_settings import AgentSettings


def undo(settings: AgentSettings) -> bool:
    """Undo it now, for every policy; what can't be undone stays in the journal. The caller holds the lock.

    False if the journal was damaged, so that it is unknown whether this was all.

    What is undone once needs no watch, and the node may have none left to give.
    """
    agent = Agent(settings, VirtualTimeScheduler(), lambda _: Unwatched())
    agent.start()
    agent.stop()
    return not agent.journal_is_damaged
