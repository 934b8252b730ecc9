from __future__ import annotations

from unittest.mock import MagicMock

import pytest

from contextpolicy.policy import key_chunks
from contextpolicy.policy.key_chunks import matched, may_match


@pytest.mark.parametrize(
    ("expression", "key", "expected"),
    [
        ("lift/*", "lift/left", "left"),
        ("*/lift/*", "r1/lift/left", "r1/left"),
        ("robot/*/lift", "robot/r1/lift", "r1"),
        ("robot/**", "robot/a/b", "a/b"),
        ("robot/**/lift", "robot/lift", ""),
        ("robot/**/lift", "robot/a/b/lift", "a/b"),
        ("**/lift/*", "a/lift/lift/left", "a/lift/left"),
        ("**", "a/b", "a/b"),
        ("**/a/**/b", "x/a/a/b", "x/a"),
        ("**/a/**/a/**", "a/x/a/y/a", "x/y/a"),
        ("a/**/@adv/*/**", "a/b/@adv/pub/1", "b/pub/1"),
        ("lift/left", "lift/left", ""),
        ("arm$*/joint", "arm7/joint", "arm7"),
        ("$*arm$*left$*/joint", "an-arm-left/joint", "an-arm-left"),
        ("a$*b$*a/x", "aba/x", "aba"),
        ("a$*a/x", "a/x", "a/x"),
        ("a$*b$*b/x", "ab/x", "ab/x"),
        ("a$*b$*b$*/x", "acb/x", "acb/x"),
        ("*/x", "@private/x", "@private/x"),
        ("lift/*/**", "lift", "lift"),
        ("**/a/**/a", "a", "a"),
        ("**/a/**/b/**", "a/c", "a/c"),
        ("lift/*", "elsewhere/left", "elsewhere/left"),
        ("lift/*", "lift/left/top", "lift/left/top"),
    ],
)
def test_chunks_matched_by_wildcards(expression, key, expected):
    assert matched(expression, key) == expected


@pytest.mark.parametrize(
    ("expression", "text", "may"),
    [
        ("lift/*", "left", True),
        ("lift/*", "lift/left", False),
        ("*/lift/*", "r1/left", True),
        ("*/lift/*", "left", False),
        ("arm$*/joint", "arm7", True),
        ("arm$*/joint", "7", False),
        ("lift/*", "@left", False),
        ("*", "@left", False),
        ("*", "left", True),
        ("lift/**", "a/b", True),
        ("lift/left", "left", False),
    ],
)
def test_texts_that_wildcards_may_match(expression, text, may):
    assert may_match(expression, text) is may


@pytest.mark.parametrize(
    ("expression", "key"),
    [
        ("lab/" + "**/a/" * 6 + "**/b", "lab/" + "a/" * 60 + "b"),
        ("lab/" + "**/a/" * 6 + "**/b/**", "lab/" + "a/" * 60 + "c"),
        ("**/b", "a/" * 30_000 + "c"),
        ("**/b/**", "a/" * 30_000 + "c"),
    ],
)
def test_a_long_key_is_compared_once(monkeypatch, expression, key):
    """Every way to divide the key among the wildcards was tried: one sample held the operator up for seconds."""
    compare = MagicMock(side_effect=key_chunks._selects)
    monkeypatch.setattr(key_chunks, "_selects", compare)
    key_chunks._match(expression.split("/"), key.split("/"))
    assert compare.call_count <= key.count("/") + expression.count("/")
