"""What could not be written, and which containers that concerns. Pure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

Failures: TypeAlias = dict[Path, ActuationError]
"""Why groups did not get what they should have. A pod's failure is one of all its containers."""

GONE = "Gone"
"""The reason when there is no such group any more: there is nothing to undo, and nothing to count."""


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
