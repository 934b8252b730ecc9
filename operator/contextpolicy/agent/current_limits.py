"""The CPU limits that are in force: those of containers, of their pods, and of the containers beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from contextpolicy.agent.cgroup_paths import is_pod
from contextpolicy.agent.child_groups import Children
from contextpolicy.agent.control_files import ControlFiles
from contextpolicy.agent.failures import GONE
from contextpolicy.agent.open_files import Unwatched
from contextpolicy.agent.steps import PodLimits
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    from contextpolicy.agent.failures import Failures
    from contextpolicy.agent.ledger import Ledger

    ContainerLimits: TypeAlias = dict[Path, tuple[int | None, int | None]]
    """Of each container (now, wanted)."""


class CurrentLimits:
    """Limits are thousandths of a core, None for no limit. Groups are those of containers and of pods.

    `files` are the open files of what policies limit; a group that is gone is dropped from them and from the ledger.
    """

    def __init__(self, files: ControlFiles, ledger: Ledger) -> None:
        self._files, self._ledger = files, ledger
        self._children, self._siblings = Children(), ControlFiles(files.form, Unwatched())

    def of(self, group: Path) -> int | None:
        """The limit of a group; ActuationError if it can't be read."""
        file = self._files[group]
        return file.amount(file.read())

    def fits(self, group: Path, limit: int | None) -> bool:
        """Whether a pod's limit is no less than the sum of its containers'; always true of a container's."""
        return limit is None or not is_pod(group) or self.beside(group, ()) <= limit

    def pods(
        self, by_pod: Mapping[Path, ContainerLimits], owned: Collection[Path], failures: Failures
    ) -> list[PodLimits]:
        """The pods with all that their limits depend on; those that can't be read become `failures`.

        `owned` are pods with a limit of their own.
        """
        pods = []
        for pod, containers in by_pod.items():
            try:
                pods.append(PodLimits(pod, self.of(pod), self.beside(pod, containers), containers, pod in owned))
            except ActuationError as error:
                self.lose(pod, error)
                failures[pod] = error
        return pods

    def beside(self, pod: Path, containers: Collection[Path]) -> int:
        """The sum of the limits of the pod's other containers; those without one (the sandbox) do not count."""
        for _ in range(2):
            amounts = [self._of_sibling(group, pod) for group in self._children.of(pod) if group not in containers]
            if None not in amounts:
                break
        return sum(amount or 0 for amount in amounts)

    def lose(self, group: Path, error: ActuationError) -> None:
        """The group's file can't be read: reopen it next time."""
        self._files.close(group)
        if error.reason == GONE:
            self._ledger.close(group / self._files.form.file)

    def keep(self, groups: Collection[Path]) -> None:
        """Close the files of all other groups, and of what is not beside these."""
        self._files.keep(groups)
        self._children.keep(groups)
        self._siblings.keep(self._children.all())

    def _of_sibling(self, group: Path, pod: Path) -> int | None:
        """The limit of a container that is not ours; None when it has ended, and another may have come in its place."""
        try:
            file = self._siblings[group]
            return file.amount(file.read()) or 0
        except ActuationError:
            self._siblings.close(group)
            self._children.forget(pod)
            return None
