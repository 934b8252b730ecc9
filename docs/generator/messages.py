"""The reference page of the decision bus, from the docstrings that a test compares with the messages."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from contextpolicy.bus import roles
from contextpolicy.bus.decision_bus import agent_key, applied_key, confirmed_key, topic_key, usage_key
from contextpolicy.planning import plan_json
from docs.generator.markdown import escaped, table

if TYPE_CHECKING:
    from collections.abc import Iterator

_INTRODUCTION = """\
# Messages on the decision bus

The operator and its agents speak JSON on Zenoh. `make docs` writes the tables from the code that builds and accepts
the messages. Everything is in cores and seconds.

"""
_POLICY, _NODE = ("<namespace>", "<policy>"), "<node>"
_KEYS = (
    (
        topic_key(*_POLICY, "plan"),
        "publication, query; liveliness token",
        "the plan in force; deleted when withdrawn; signed ([how](../explanation/security.md#signed-plans))",
    ),
    (
        applied_key(*_POLICY),
        "publication",
        "`container`, its `cores`, the `stage` that they have reached (`accepted`, then `inForce`), and the `time`",
    ),
    (topic_key(*_POLICY, "explain"), "query", "why each task has its share, as `explain` prints it in JSON"),
    (topic_key(*_POLICY, "board"), "query", "what the live page shows; its fields may change with every version"),
    (agent_key(_NODE), "query; liveliness token", "what the node's agent can do, and what it lacks"),
    (
        confirmed_key(_NODE),
        "publication",
        "`policy` and `stamp` (run, sequence, edition) of a plan that was written; `failed`: why, by container",
    ),
    (usage_key(_NODE), "query", "the CPU time that the containers of all plans have used"),
)
_PLAN = "## The plan\n\n`simulate --output json` and recordings have the same fields.\n"
_BUS = "## What only the bus has\n"
_ROLES = "## Who may publish and receive what\n\nThe role is the certificate's common name, or the user name.\n"


def page() -> str:
    """The page as Markdown."""
    plan, bus = _tables(plan_json.__doc__ or "")
    (allowed,) = _tables(roles.__doc__ or "")
    keys = ((f"`{key}`", *about) for key, *about in _KEYS)
    tables = [*table(("key", "kind", "what it carries"), keys), _PLAN, *_fields(plan[1:]), _BUS, *_fields(bus)]
    return "\n".join([_INTRODUCTION, *tables, _ROLES, *table(allowed[0], allowed[1:])])


def _fields(rows: list[list[str]]) -> list[str]:
    return table(("field", "meaning"), ((f"`{name}`", escaped(meaning)) for name, meaning in rows))


def _tables(docstring: str) -> Iterator[list[list[str]]]:
    """The simple tables of reStructuredText with two columns; a row may go on in lines whose first column is empty."""
    for body in re.findall(r"^=+ +=+\n(.*?\n)^=+ +=+$(?!\n\S)", _without_rules(docstring), re.MULTILINE | re.DOTALL):
        rows: list[list[str]] = []
        for line in body.splitlines():
            name, _, text = line.partition("  ") if not line.startswith(" ") else ("", "", line)
            if name:
                rows.append([name, text.strip()])
            else:
                rows[-1][1] += f" {text.strip()}"
        yield rows


def _without_rules(docstring: str) -> str:
    """Without the rule below each header, so that two rules enclose a table."""
    return re.sub(r"(^=+ +=+\n[^\n]+\n)=+ +=+\n", r"\1", docstring, flags=re.MULTILINE)
