"""Contexts in conditions: how `contexts.moving` is read and written, and how contexts depend on each other."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING

from contextpolicy.policy.cel_syntax import Construct, Node

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

CONTEXTS = "contexts"
"""The word under which expressions find the policy's contexts."""
_VARIABLE = "__context_"


def read_context(node: Node) -> str | None:
    """The context that `contexts.moving` or `contexts['low-battery']` names; None for any other node."""
    if node.kind not in {Construct.SELECT, Construct.INDEX} or not _is_contexts(node.parts[0]):
        return None
    if node.kind is Construct.INDEX:
        raise ValueError("indexes contexts with something other than a quoted name, such as contexts['low-battery']")
    return node.text


def check_name(name: str) -> None:
    """ValueError for a name that stands for all contexts: they can only be asked one by one."""
    if name == CONTEXTS:
        raise ValueError("uses contexts for something other than one context, such as contexts.moving")


def variable(context: str) -> str:
    """The variable that says whether the context is active. No stream's name can begin so."""
    return _VARIABLE + context.replace("-", "_")  # a context's name has no underscore


class Dependencies:
    """Which contexts the condition of each reads."""

    def __init__(self, reads: Mapping[str, Iterable[str]]) -> None:
        self._reads = {name: [one for one in read if one in reads] for name, read in reads.items()}

    def ranks(self) -> dict[str, int]:
        """Each context's place in the order of evaluation: 0 if it reads no other, else after all that it reads."""
        ranks: dict[str, int] = {}
        for name in TopologicalSorter(self._reads).static_order():
            ranks[name] = rank_after(self._reads[name], ranks)
        return ranks

    def cycle(self) -> list[str] | None:
        """Contexts that read each other, each followed by the one that it reads, the first repeated at the end."""
        try:
            TopologicalSorter(self._reads).prepare()
        except CycleError as error:
            path: list[str] = list(reversed(error.args[1]))
            names = path[:-1]
            first = min(range(len(names)), key=lambda at: list(self._reads).index(names[at]))
            return [*names[first:], *names[:first], names[first]]
        return None


def rank_after(read: Iterable[str], ranks: Mapping[str, int]) -> int:
    """The place of what reads these contexts."""
    return max((ranks[one] + 1 for one in read), default=0)


def _is_contexts(node: Node) -> bool:
    return node.kind is Construct.NAME and node.text == CONTEXTS
