"""A graph as Mermaid text, which GitHub and many editors draw."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.explain.task_graph import Kind, Relation

if TYPE_CHECKING:
    from contextpolicy.explain.task_graph import Edge, Graph, GraphNode

_SHAPES = {
    Kind.STREAM: ("([", "])"),
    Kind.TASK: ("[", "]"),
    Kind.GROUP: ("[[", "]]"),
    Kind.NEED: ("[/", "/]"),
    Kind.CONTEXT: ("{{", "}}"),
}
_ARROWS = {
    Relation.ACTIVITY: "-->",
    Relation.CONDITION: "==>",
    Relation.PRODUCES: "-->",
    Relation.SUBTASK: "---",
    Relation.NEEDS: "-.-",
    Relation.READS: "-.->",
    Relation.CHANGES: "-.->",
}
_STYLES = (
    "classDef stream fill:#e8f1f8,stroke:#2a6f97",
    "classDef task fill:#fdf3e7,stroke:#e07a3f",
    "classDef group fill:#f7e1cf,stroke:#e07a3f",
    "classDef need fill:#f3f3f3,stroke:#999999",
    "classDef context fill:#fdf0c8,stroke:#c99700",
    "classDef suspended fill:#eeeeee,stroke:#b5495b,color:#888888,stroke-dasharray:4 3",
)


def mermaid(graph: Graph) -> str:
    """A flowchart; thick arrows are pre-conditions, dotted ones needs and contexts."""
    return "\n".join(
        [
            "---",
            f"title: {graph.title}",
            "---",
            "flowchart LR",
            *(f"  {_node(node)}" for node in graph.nodes),
            *(f"  {_edge(edge)}" for edge in graph.edges),
            *(f"  {style}" for style in _STYLES),
        ]
    )


def _node(node: GraphNode) -> str:
    before, after = _SHAPES[node.kind]
    text = "<br/>".join(_escaped(line) for line in node.lines)
    return f'{node.id}{before}"{text}"{after}:::{"suspended" if node.suspended else node.kind}'


def _edge(edge: Edge) -> str:
    label = f'|"{_escaped(edge.label)}"|' if edge.label else ""
    return f"{edge.source} {_ARROWS[edge.relation]}{label} {edge.target}"


def _escaped(text: str) -> str:
    """Mermaid writes special characters as #code; between quotes only these few are special."""
    return "".join(f"#{ord(c)};" if c in '"#<>&;`' else c for c in text)
