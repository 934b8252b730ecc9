import subprocess

import pytest

from tests.node import cache, context


@pytest.fixture
def sources(tmp_path):
    folder = tmp_path / "sources"
    (folder / "sub").mkdir(parents=True)
    (folder / "a.txt").write_text("a")
    (folder / "sub" / "b.txt").write_text("b")
    return folder


def key_of(folder, *values):
    return cache.key(*values, files=context.files(folder), root=folder)


def test_key_does_not_depend_on_where_the_folder_is(sources, tmp_path):
    before = key_of(sources)
    moved = sources.rename(tmp_path / "moved")
    assert key_of(moved) == before


@pytest.mark.parametrize(
    "change",
    [
        lambda folder: (folder / "a.txt").write_text("A"),
        lambda folder: (folder / "a.txt").rename(folder / "c.txt"),
        lambda folder: (folder / "a.txt").chmod(0o755),
        lambda folder: (folder / "new").touch(),
        lambda folder: (folder / "sub" / "b.txt").unlink(),
    ],
    ids=["content", "name", "mode", "added", "removed"],
)
def test_key_changes_with_the_files(sources, change):
    before = key_of(sources)
    change(sources)
    assert key_of(sources) != before


def test_key_changes_with_the_values(sources):
    assert key_of(sources, "v1") != key_of(sources, "v2")


def test_gitignored_files_are_skipped(sources):
    subprocess.run(["git", "init", "--quiet", str(sources)], check=True)
    (sources / ".gitignore").write_text("*.log\n")
    (sources / "noise.log").touch()
    names = {path.name for path in cache.source_files(sources)}
    assert names == {".gitignore", "a.txt", "b.txt"}


def test_folder_is_filled_once(tmp_path):
    calls: list[object] = []
    for _ in range(2):
        cache.folder(tmp_path / "x", calls.append)
    assert len(calls) == 1


def test_a_folder_whose_filling_fails_leaves_nothing(tmp_path):
    def fail(draft):
        (draft / "half").touch()
        raise OSError

    with pytest.raises(OSError):  # noqa: PT011, the very error that was raised
        cache.folder(tmp_path / "x", fail)
    assert list(tmp_path.iterdir()) == []


def test_the_first_of_two_concurrent_fills_wins(tmp_path):
    def slow(draft):
        (draft / "slow").touch()
        (tmp_path / "x").mkdir()
        (tmp_path / "x" / "fast").touch()

    cache.folder(tmp_path / "x", slow)
    assert [path.name for path in (tmp_path / "x").iterdir()] == ["fast"]
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


@pytest.mark.parametrize(
    ("path", "ignored"),
    [
        ("README.md", False),
        ("docs/a.md", True),
        ("operator/x/y.py", False),
        ("operator/x/__pycache__/y.pyc", True),
        ("operators/x.py", True),
    ],
)
def test_dockerignore_takes_the_last_rule_that_matches(path, ignored):
    rules = ["# a comment", "*", "!README.md", "!operator", "", "**/__pycache__"]
    assert context.ignored(path, rules) is ignored
