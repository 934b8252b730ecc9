"""A graph as SVG, laid out and drawn by Graphviz: streams on the left, what they lead to on the right."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

from contextpolicy.errors import DrawingError
from contextpolicy.explain.task_graph import Kind, Relation

if TYPE_CHECKING:
    from contextpolicy.explain.task_graph import Edge, Graph, GraphNode

LABEL_LENGTH = 36
"""Characters of an edge's label; a longer one is cut, and shown whole as a tooltip."""

_FILLS = {
    Kind.STREAM: ("#e8f1f8", "#2a6f97"),
    Kind.TASK: ("#fdf3e7", "#e07a3f"),
    Kind.GROUP: ("#f7e1cf", "#e07a3f"),
    Kind.NEED: ("#f3f3f3", "#999999"),
    Kind.CONTEXT: ("#fdf0c8", "#c99700"),
}
_SUSPENDED = ("#eeeeee", "#b5495b")
_LINES = {
    Relation.ACTIVITY: ("#2a6f97", 1.3, "solid"),
    Relation.CONDITION: ("#2a6f97", 2.6, "solid"),
    Relation.PRODUCES: ("#5b8e55", 1.3, "solid"),
    Relation.SUBTASK: ("#e07a3f", 1.3, "solid"),
    Relation.NEEDS: ("#999999", 1.0, "dotted"),
    Relation.READS: ("#c99700", 1.0, "dashed"),
    Relation.CHANGES: ("#c99700", 1.6, "dashed"),
}
_LEGEND = {
    Relation.ACTIVITY: "— makes active",
    Relation.CONDITION: "<b>— pre-condition</b>",
    Relation.PRODUCES: "— produces",
    Relation.SUBTASK: "— subtask",
    Relation.CHANGES: "-- context",
}
_FONT = {"fontname": "Helvetica"}


def svg(graph: Graph) -> str:
    """The whole picture with a title and a legend; DrawingError without Graphviz."""
    try:
        import pygraphviz  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise DrawingError("drawing needs Graphviz: pip install '.[plot]' in a checkout") from error
    picture = pygraphviz.AGraph(directed=True, strict=False, rankdir="LR", nodesep=0.25, ranksep=0.6, pad=0.2)
    picture.graph_attr.update(_FONT, label=_legend(), labelloc="b", fontsize=10.5)
    picture.node_attr.update(_FONT, fontsize=12, shape="box", margin="0.15,0.07", height=0.3)
    picture.edge_attr.update(_FONT, fontsize=10.5, arrowsize=0.8)
    # A graph has one label: the outer one's is the legend, so the title needs a subgraph of its own.
    title = {"label": f"<<b>{escape(graph.title)}</b>>", "fontsize": 17, "labeljust": "l", "labelloc": "t"}
    inside = picture.add_subgraph(name="cluster_picture", peripheries=0, **title)
    for node in graph.nodes:
        inside.add_node(node.id, **_node(node))
    for number, edge in enumerate(graph.edges):
        if edge.relation is Relation.NEEDS:
            inside.add_subgraph([edge.source, edge.target], rank="same")
        inside.add_edge(edge.source, edge.target, key=str(number), **_edge(edge))
    return str(picture.draw(format="svg", prog="dot").decode())


def _node(node: GraphNode) -> dict[str, Any]:
    fill, color = _SUSPENDED if node.suspended else _FILLS[node.kind]
    styles = ["filled", *["rounded"] * (node.kind in (Kind.STREAM, Kind.CONTEXT)), *["dashed"] * node.suspended]
    first, *more = map(_text, node.lines)
    text = [first if node.kind is Kind.NEED else f"<b>{first}</b>", *more]
    font = "#888888" if node.suspended else "black"
    return {
        "label": f"<{'<br/>'.join(text)}>",
        "style": ",".join(styles),
        "fillcolor": fill,
        "color": color,
        "fontcolor": font,
    }


def _edge(edge: Edge) -> dict[str, Any]:
    color, width, style = _LINES[edge.relation]
    cut = edge.label if len(edge.label) <= LABEL_LENGTH else edge.label[: LABEL_LENGTH - 1] + "…"
    head = "none" if edge.relation in (Relation.SUBTASK, Relation.NEEDS) else "normal"
    looks = {"color": color, "fontcolor": color, "penwidth": width, "style": style, "arrowhead": head}
    return looks | ({"label": f"<{_text(cut)}>", "labeltooltip": _text(edge.label)} if edge.label else {})


def _text(text: str) -> str:
    r"""Escaped for a label in `<...>`, in which Graphviz would still expand \N to the node's id."""
    return escape(text).replace("\\", r"\\")


def _legend() -> str:
    words = (f'<font color="{_LINES[relation][0]}">{text}</font>' for relation, text in _LEGEND.items())
    return f"<{'    '.join(words)}>"
