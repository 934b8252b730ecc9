"""An agent's limits in one life, and what the kubelet writes beside them."""

from __future__ import annotations

from time import monotonic

from contextpolicy.agent.control_files import CFS, ControlFiles
from contextpolicy.agent.ledger import Ledger
from contextpolicy.agent.limits import Limits
from contextpolicy.agent.open_files import Unwatched
from tests.agent.builders import POLICY

OTHER = "robot/other"


class Planned(Limits):
    """An agent's life: it carries on what the journal says."""

    def __init__(self, tree, journal):
        self.ledger = Ledger(journal)
        self.ledger.load()
        super().__init__(ControlFiles(CFS[tree.version], Unwatched()), self.ledger)

    def plan(self, limits, held=(), policy=POLICY, owned=(), **originals):
        """What each container had before any policy is half a core, unless `original` says otherwise."""
        self.apply(policy, limits, held, dict.fromkeys(limits, originals.get("original", 500)), owned=owned)


def write(tree, limits, group, limit):
    """The kubelet writes and the watch reports it."""
    tree.set(group, limit)
    report_late(tree, limits, group)


def resize(tree, limits, group, limit):
    """The kubelet writes a container that is alone in its pod: the pod first where it rises, else the container."""
    for each in [group.parent, group] if limit > tree.limit(group.parent) else [group, group.parent]:
        write(tree, limits, each, limit)


def report_late(tree, limits, group):
    """The watch reports a write that the agent may have overwritten meanwhile."""
    limits.on_other_write(tree.limit_file(group), monotonic())
