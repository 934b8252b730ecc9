"""Who may publish and receive what on the bus, as Zenoh's access control. Pure.

========  =============================================================================================================
role      what it does
========  =============================================================================================================
sensor    publishes samples, receives nothing
module    publishes and receives samples, answers queries for its profile, receives and queries plans, sees ROS's graph
operator  receives samples and agents' reports, publishes plans, explains them
agent     receives and queries plans, reports what its node can do, confirms plans
viewer    receives and queries whatever operator and agents publish: `contextpolicy top` and `explain`
========  =============================================================================================================

Sensors and modules may be nodes of ROS.

Everything else is denied. The keys that matter are listed, never carved out of `**` by a denial: Zenoh lets anybody
publish on a key with wildcards, and a denial of `contextpolicy/**` does not cover `*/robot/delivery/plan`, which
reaches everyone who subscribes to plans. So the denial below is only half the protection: agents are sent nothing
outside `contextpolicy/*/*/plan`, which does not include such a key, and the plans themselves are signed.

A fleet's router, which robots' routers join, admits two: routers, which pass on what their operators and agents say and
pass questions down, and viewers. To a robot it shows a viewer's certificate, so that nothing but interest and questions
comes from it: neither samples nor plans go from robot to robot, and no other robot can publish to its agents.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

OWN = "contextpolicy"
"""The first part of the keys on which only operators and agents speak."""
_OWN = [f"{OWN}/**"]
_LETTERS = [letter for letter in map(chr, range(0x21, 0x7F)) if letter not in "#$*/?@"]
"""What a part of a key may begin with; Zenoh has other uses for the rest."""
_PLANS = ["contextpolicy/*/*/plan"]
_GRAPH = ["@ros2_lv/**"]
"""Where rmw_zenoh says which nodes, publishers, subscriptions and services there are; nothing else covers an @."""
_PUBLISH = ["put", "liveliness_token", "declare_queryable", "reply"]
_SAY = ["put", "delete", "liveliness_token", "declare_queryable", "reply"]
_LISTEN = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query", "query"]
_HEAR = ["put", "delete", "liveliness_token", "declare_queryable", "reply"]
_ASK_WHO = ["declare_liveliness_subscriber", "liveliness_query"]
_BE_HEARD = ["declare_subscriber", *_ASK_WHO]
_SPEAK = (
    *("publish-samples", "leave-plans-alone", "answer-for-samples", "answer-for-nobody-else", "know-listeners"),
    *("join-the-graph", "be-asked-for-the-graph"),
)
_RULES = {
    "sensor": _SPEAK,
    "module": (*_SPEAK, "listen", "hear", "ask-for-the-graph", "see-the-graph"),
    "operator": ("listen", "hear", "decide", "know-who-follows"),
    "agent": ("follow-plans", "hear-plans", "report", "confirm", "know-who-follows"),
    "viewer": ("view", "see"),
}

ROLES = tuple(_RULES)
"""Those who may connect to a robot's router."""


def access_control(samples: Sequence[str] = (), *, by: str = "cert_common_names") -> dict[str, Any]:
    """Zenoh's `access_control`: samples on these keys; `by` is what names a role, cert_common_names or usernames.

    Without keys samples may have any but our own.
    """
    said, keys = _with_latched(samples or all_but(OWN)), _with_latched(samples or ["**"])
    rules = [
        _rule("publish-samples", "ingress", _PUBLISH, said),
        _rule("answer-for-samples", "egress", ["query"], keys),
        _rule("leave-plans-alone", "ingress", _PUBLISH, _OWN, permission="deny"),
        _rule("answer-for-nobody-else", "egress", ["query"], _OWN, permission="deny"),
        _rule("know-listeners", "egress", _BE_HEARD, keys),
        _rule("join-the-graph", "ingress", ["liveliness_token"], _GRAPH),
        _rule("be-asked-for-the-graph", "egress", _ASK_WHO, _GRAPH),
        _rule("ask-for-the-graph", "ingress", _ASK_WHO, _GRAPH),
        _rule("see-the-graph", "egress", ["liveliness_token"], _GRAPH),
        _rule("listen", "ingress", _LISTEN, [*keys, *_OWN]),
        _rule("hear", "egress", _HEAR, [*keys, *_OWN]),
        _rule(
            "decide",
            "ingress",
            _SAY,
            [f"contextpolicy/*/*/{what}" for what in ("plan", "applied", "explain", "board")],
        ),
        _rule("follow-plans", "ingress", _LISTEN, _PLANS),
        _rule("hear-plans", "egress", _HEAR, _PLANS),
        _rule(
            "report",
            "ingress",
            ["liveliness_token", "declare_queryable", "reply"],
            ["contextpolicy/agents/*", "contextpolicy/agents/*/usage"],
        ),
        _rule("confirm", "ingress", ["put"], ["contextpolicy/agents/*/confirmed"]),
        _rule("know-who-follows", "egress", [*_BE_HEARD, "query"], _OWN),
        _rule("view", "ingress", _LISTEN, _OWN),
        _rule("see", "egress", _HEAR, _OWN),
    ]
    return _only(_RULES, rules, by)


def all_but(first: str) -> list[str]:
    """Key expressions that together cover every key but those whose first part is `first`.

    `**` would cover too much: a queryable on it that calls itself complete draws all queries to itself, those for plans
    and reports as well. Zenoh can't subtract, so this lists where another first part may begin to differ, which may be
    at any letter. Keys that begin with a letter outside of ASCII have to be named (`security.sampleKeys`).
    """
    begun = [first[:length] for length in range(len(first) + 1)]
    differing = [
        f"{begin}{letter}$*/**" for begin in begun for letter in _LETTERS if not first.startswith(begin + letter)
    ]
    return [*differing, *(f"{begin}/**" for begin in begun[1:-1])]


def fleet_access_control() -> dict[str, Any]:
    """The same for a router that robots' routers join, and people watch all robots at."""
    rules = [
        _rule("pass-on", "ingress", _SAY, _OWN),
        _rule("pass-down", "egress", [*_BE_HEARD, "query"], _OWN),
        _rule("view", "ingress", _LISTEN, _OWN),
        _rule("see", "egress", _HEAR, _OWN),
    ]
    return _only({"router": ("pass-on", "pass-down"), "viewer": _RULES["viewer"]}, rules, "cert_common_names")


def _only(rights: Mapping[str, Sequence[str]], rules: list[dict[str, Any]], by: str) -> dict[str, Any]:
    """What no right allows is denied."""
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": role, by: [role]} for role in rights],
        "policies": [{"subjects": [role], "rules": list(names)} for role, names in rights.items()],
    }


def _with_latched(keys: Sequence[str]) -> list[str]:
    """Latched ROS 2 topics (Zenoh's advanced publishers) use @adv; no wildcard matches a chunk that begins with @."""
    return [*keys, *(f"{key}/@adv/**" for key in keys)]


def _rule(name: str, flow: str, messages: list[str], keys: list[str], permission: str = "allow") -> dict[str, Any]:
    return {"id": name, "permission": permission, "flows": [flow], "messages": messages, "key_exprs": keys}
