"""How planning names containers. Apart from the rest of `cluster`, because the agent does without the API."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import PodView


def container_id(pod: PodView, container: str) -> str:
    """The name that planning uses for a container: unique, and the same after a restart of the operator."""
    return f"{pod.namespace}/{pod.name}/{container}"
