from __future__ import annotations

import pytest

from contextpolicy.policy.validation.documents import DocumentError, Position, read

BOMB = "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "\n".join(
    f"{name}: &{name} [{','.join(['*' + before] * 10)}]" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2026-01-01T00:00:00Z", "2026-01-01T00:00:00Z"),
        ("1:30", "1:30"),
        ("1e3", 1000.0),
        ("0x10", 16),
        ("-3", -3),
        ("1.5", 1.5),
        ("yes", True),
        ("'1'", "1"),
        ("500m", "500m"),
        ("=", "="),
        ("", None),
    ],
)
def test_scalars_are_what_the_api_server_reads(text: str, value: object) -> None:
    (document,) = read(f"a: {text}")
    assert document.body == {"a": value}


def test_every_field_has_its_place() -> None:
    (document,) = read("spec:\n  tasks:\n  - name: a\n    min: 5\n")
    assert document.position("spec.tasks[0].min") == Position(4, 5)
    assert document.position("spec.tasks[0].selector.matchLabels") == Position(3, 5)
    assert document.position("metadata.name") == Position(1, 1)


def test_documents_of_one_stream_keep_their_lines() -> None:
    assert [d.position("").line for d in read("a: 1\n---\n---\nb: 2\n")] == [1, 3, 4]


def test_a_duplicate_key_is_noted() -> None:
    (document,) = read("a: {b: 1, b: 2}")
    assert document.duplicates == ("a.b",)


def test_merge_keys_and_aliases_are_expanded() -> None:
    (document,) = read("base: &b {x: 1, z: 2}\nown:\n  <<: *b\n  z: 3\n")
    assert document.body["own"] == {"x": 1, "z": 3}


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (BOMB, 1, "more than 100000 values"),
        ("a: &a [*a]", 1, "contains itself"),
        ("[" * 5000, 1, "nested deeper than 64"),
        ("a: [1", 1, "expected ',' or ']'"),
        ("a: 1\nb: *x", 2, "undefined alias"),
        ("? [a]\n: 1", 1, "a key that is not a string"),
        ("a: !!int x", 1, "not a valid value"),
        ("a: !!python/object:os.system x", 1, "constructor"),
        ("a: \x00", 1, "unacceptable character"),
        ("x" * (2**20 + 1), 1, "expected at most 1048576"),
    ],
)
def test_unreadable_documents_are_refused_with_their_line(text: str, line: int, message: str) -> None:
    with pytest.raises(DocumentError, match=message) as caught:
        list(read(text))
    assert caught.value.position.line == line


def test_all_keys_that_yaml_reads_as_one_are_named():
    (document,) = read("on: 1\ny: 2\nno: 3\n")
    assert document.yes_and_no_keys == {"true": "on and y", "false": "no"}
