"""`python -m timelines.recording.layout POLICY.yaml`: print a Foxglove layout for a policy, to be imported.

The figures of the operator's live page, from a recording or from the bus (`timelines.recording.live`): context bands,
normalised weights and shares (the paper's Figures 5 and 7), limits in force and the CPU that is used, misses, and the
cause of each plan.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from foxglove import layouts

from contextpolicy.bus.decision_bus import plan_key
from contextpolicy.errors import ContextPolicyError
from contextpolicy.explain.palette import task_colors
from contextpolicy.policy.validation.policy_file import load_policy

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from contextpolicy.policy.spec import Policy

WINDOW = 120.0
"""Seconds that a live view spans, as on the live page."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the layout; exit code 2 when the policy is refused."""
    parser = argparse.ArgumentParser(prog="python -m timelines.recording.layout", description=__doc__.split("\n")[0])
    parser.add_argument("policy", metavar="POLICY", help="a file with one ContextPolicy")
    try:
        policy = load_policy(parser.parse_args(arguments).policy)
    except ContextPolicyError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(as_text(policy))
    return 0


def as_text(policy: Policy) -> str:
    """The layout's file."""
    return json.dumps(json.loads(layout(policy).to_json()), indent=1) + "\n"


def layout(policy: Policy) -> layouts.Layout:
    """The figures on the left, what they are made of on the right."""
    plans, tasks = plan_key(policy.namespace, policy.name), [task.name for task in policy.leaves]
    state = f"{plans}/state"
    figures = [
        (1.0, _bands("Contexts", [path(state, "contexts")])),
        (3.0, _plot("Weights, normalised (Figure 5)", [(n, path(state, "tasks", n, "weight")) for n in tasks])),
        (3.0, _plot("Shares in cores (Figure 7)", [(n, path(state, "tasks", n, "share")) for n in tasks])),
        (3.0, _plot("Limits in force, in cores", [(n, path(f"cgroup/{n}", "limit")) for n in tasks])),
    ]
    log, raw = layouts.LogConfig(topic_to_render=f"{plans}/shown"), layouts.RawMessagesConfig(topic_path=path(plans))
    details = [
        (2.0, layouts.LogPanel(title="Plans and their causes", config=log)),
        (2.0, _plot("CPU used, in cores", [(n, f"{path(f'cgroup/{n}', 'usage')}.@derivative") for n in tasks])),
        (2.0, _plot("Inputs missed, as a part", [(n, path(f"robot/{n}/health", "misses")) for n in tasks])),
        (3.0, layouts.RawMessagesPanel(title="Plan", config=raw)),
    ]
    columns = [(3.0, _split("column", figures)), (2.0, _split("column", details))]
    return layouts.Layout(content=_split("row", columns))


def path(topic: str, *fields: str) -> str:
    """A message path; quotes around what has slashes or dashes in it."""
    return ".".join(part if part.isidentifier() else f'"{part}"' for part in (topic, *fields))


def _bands(title: str, paths: Iterable[str]) -> layouts.StateTransitionsPanel:
    series = [layouts.StateTransitionsSeries(value=one, enabled=True, timestamp_method="receiveTime") for one in paths]
    return layouts.StateTransitionsPanel(
        title=title, config=layouts.StateTransitionsConfig(paths=series, is_synced=True)
    )


def _plot(title: str, paths: Iterable[tuple[str, str]]) -> layouts.PlotPanel:
    """Values hold until the next one: steps, not slopes. A task has the colour that it has on the live page."""
    named = dict(paths)
    colors = task_colors(named)
    series = [
        layouts.PlotSeries(
            value=value,
            label=task,
            color=colors[task],
            enabled=True,
            timestamp_method="receiveTime",
            line_interpolation="step",
        )
        for task, value in named.items()
    ]
    return layouts.PlotPanel(
        title=title,
        config=layouts.PlotConfig(
            paths=series, is_synced=True, show_legend=True, min_y_value=0.0, following_view_width=WINDOW
        ),
    )


def _split(direction: str, items: Iterable[tuple[float, layouts.Content]]) -> layouts.SplitContainer:
    parts = [layouts.SplitItem(proportion=part, content=content) for part, content in items]
    return layouts.SplitContainer(direction="row" if direction == "row" else "column", items=parts)


if __name__ == "__main__":
    sys.exit(main())
