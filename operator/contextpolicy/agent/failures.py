"""What could not be written, and which containers that concerns. Pure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

Failures: TypeAlias = dict[Path, ActuationError]
"""Why groups did not get what they should have. A pod's failure is one of all its containers."""

GONE = "Gone"
"""The reason when the group no longer exists: nothing is left to undo or to count."""
NOT_ENABLED = "NotEnabled"
"""The reason when the group is there without the file: the CPU controller is not enabled for it."""


def attempt(action: Callable[[], object], *groups: Path) -> Failures:
    """Call `action`, on whose success the groups depend; returns their failure."""
    try:
        action()
    except ActuationError as error:
        return dict.fromkeys(groups, error)
    return {}


def by_container(failures: Failures, containers: Mapping[Path, str]) -> dict[str, str]:
    """The reason by container ID, for each of the `containers` (ID by group) that is in a group that failed."""
    if not failures:
        return {}
    above = {container: [group, *group.parents] for group, container in containers.items()}
    causes = {container: [failures[g].reason for g in groups if g in failures] for container, groups in above.items()}
    return {container: reasons[0] for container, reasons in causes.items() if reasons}


def outside(failures: Failures, plans: Iterable[Collection[Path]]) -> Failures:
    """Failures in groups that are neither of a plan's containers nor above one: what was to be undone. None is gone."""
    if not failures:
        return {}
    own = {above for containers in plans for container in containers for above in (container, *container.parents)}
    return {group: error for group, error in failures.items() if group not in own and error.reason != GONE}
