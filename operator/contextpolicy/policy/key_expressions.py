"""Zenoh key expressions as a policy writes them. Zenoh itself decides: no regular expression can state its rules."""

from __future__ import annotations

import zenoh


def selects(expression: str, key: str) -> bool:
    """Whether `expression` selects `key`, a key without wildcards."""
    return zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key))


def meet(one: str, other: str) -> bool:
    """Whether some key is selected by both expressions; False if one of them is invalid."""
    try:
        return zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other))
    except (zenoh.ZError, UnicodeEncodeError):
        return False


def refusal(expression: str) -> str:
    """Why Zenoh refuses the expression; empty when it does not."""
    try:
        zenoh.KeyExpr(expression)
    except zenoh.ZError as error:
        return str(error).removeprefix(f"Invalid Key Expr `{expression}`: ").rpartition(" at /")[0]
    except UnicodeEncodeError:
        return "it has characters that UTF-8 can't encode"
    return ""


def excess(expression: str) -> str:
    """Why a policy can't have the expression, although Zenoh does; empty when it can.

    Zenoh tries every way to divide a key among several `**`, so that one long key, which any sender may choose, would
    keep it busy forever.
    """
    several = expression.split("/").count("**") > 1
    return "`**` may occur once, as long keys would take too long to match" if several else ""
