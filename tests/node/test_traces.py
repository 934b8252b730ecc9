import pytest

from tests.node import traces


@pytest.fixture
def host(tmp_path, monkeypatch):
    """Stand in for the host: one sysctl, a folder that is there and one that is not."""
    (tmp_path / "sys").mkdir()
    (tmp_path / "sys" / "panic").write_text("0\n")
    (tmp_path / "there").mkdir()
    monkeypatch.setattr(traces, "FOLDERS", (str(tmp_path / "there"), str(tmp_path / "absent")))
    monkeypatch.setattr(traces, "SYSCTLS", ("panic",))
    monkeypatch.setattr(traces, "_sysctl", lambda name: tmp_path / "sys" / name)
    return tmp_path


def test_only_changes_of_the_node_are_undone(host):
    traces.remember(host / "memory.json")
    (host / "absent").mkdir()
    (host / "sys" / "panic").write_text("10")
    traces.undo(host / "memory.json")
    assert (host / "there").is_dir()
    assert not (host / "absent").exists()
    assert (host / "sys" / "panic").read_text() == "0"


def test_a_second_start_keeps_the_recorded_originals(host):
    traces.remember(host / "memory.json")
    (host / "sys" / "panic").write_text("10")
    traces.remember(host / "memory.json")
    traces.undo(host / "memory.json")
    assert (host / "sys" / "panic").read_text() == "0"


def test_nothing_is_undone_without_a_record(host):
    traces.undo(host / "memory.json")
    assert (host / "sys" / "panic").read_text() == "0\n"
