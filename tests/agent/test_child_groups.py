from __future__ import annotations

from contextpolicy.agent.child_groups import Children, children


def test_missing_directory_has_no_children(tmp_path):
    (tmp_path / "child").mkdir()
    (tmp_path / "file").touch()
    assert children(tmp_path) == [tmp_path / "child"]
    assert children(tmp_path / "gone") == []


def test_children_are_listed_again_when_their_number_changes(tmp_path):
    known = Children()
    (tmp_path / "a").mkdir()
    assert known.of(tmp_path) == [tmp_path / "a"]
    (tmp_path / "b").mkdir()
    assert sorted(known.of(tmp_path)) == [tmp_path / "a", tmp_path / "b"]


def test_children_are_listed_again_when_one_was_found_gone(tmp_path):
    known = Children()
    (tmp_path / "a").mkdir()
    known.of(tmp_path)
    (tmp_path / "a").rename(tmp_path / "b")
    assert known.of(tmp_path) == [tmp_path / "a"], "their number is the same"
    known.forget(tmp_path)
    assert known.of(tmp_path) == [tmp_path / "b"]


def test_a_group_that_is_gone_has_no_children(tmp_path):
    assert Children().of(tmp_path / "none") == []


def test_children_of_unused_groups_are_forgotten(tmp_path):
    known = Children()
    for name in ("a/x", "b/y"):
        (tmp_path / name).mkdir(parents=True)
        known.of((tmp_path / name).parent)
    known.keep({tmp_path / "a"})
    assert known.all() == [tmp_path / "a" / "x"]
