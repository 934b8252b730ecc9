"""Every sample policy is compared, and a difference is noticed."""

import pytest

from tests.arm64 import __main__ as command_line
from tests.arm64 import emulation
from tests.node import base, images, shell
from tests.node.layout import REPOSITORY


def test_every_sample_policy_is_simulated_in_both():
    simulated = [line for line in command_line.lines() if line[0] == "simulate"]
    assert len(simulated) == len(list((REPOSITORY / "config" / "expectations").glob("*.yaml")))
    assert all(line[-2:] == ["--output", "json"] for line in simulated)
    named = {word for line in simulated for word in line if word.startswith(("config/", "timelines/"))}
    assert all((REPOSITORY / word).is_file() for word in named)


@pytest.mark.parametrize(("foreign", "same"), [("0.5", True), ("0.50", False)])
def test_outputs_must_match_byte_for_byte(monkeypatch, caplog, foreign, same):
    answers = {"native": "0.5", "foreign": foreign}
    monkeypatch.setattr(images, "run", lambda image, _argv, **_: answers[image])
    caplog.set_level("INFO")
    assert command_line.same(["simulate"], "native", "foreign") is same
    assert ("identical" if same else "DIFFERENT") in caplog.text


def test_input_files_are_mounted_where_the_image_can_read_them(monkeypatch, tmp_path):
    """A checkout may be below a home directory, which the image's user can't enter."""
    ran: list[list[str]] = []

    def run(argv, **_):
        ran.append(argv)
        return ""

    monkeypatch.setattr(shell, "run", run)
    monkeypatch.setattr(images, "STORE", tmp_path)
    command_line._answer("image", ["simulate", "config/policies/a.yaml"])
    [argv] = [argv for argv in ran if "simulate" in argv]
    assert f"{REPOSITORY / 'config'}:/srv/config:ro" in argv
    assert argv[-1] == "/srv/config/policies/a.yaml"


@pytest.fixture
def commands(monkeypatch):
    called: list[list[str]] = []
    monkeypatch.setattr(emulation, "run", called.append)
    monkeypatch.setattr(emulation, "install_packages", lambda names: called.append(["install", *names]))
    return called


def test_emulator_is_unregistered_afterwards(monkeypatch, tmp_path, commands):
    monkeypatch.setattr(emulation, "FORMATS", tmp_path)
    with emulation.registered():
        assert [words[0] for words in commands] == ["install", "mount", "update-binfmts"]
        assert commands[0][1:] == list(emulation.DEBIAN_PACKAGES)
    assert [words[:2] for words in commands[3:]] == [["update-binfmts", "--disable"], ["umount", str(tmp_path)]]


def test_emulator_registered_before_is_kept(monkeypatch, tmp_path, commands):
    monkeypatch.setattr(emulation, "FORMATS", tmp_path)
    for name in ("register", emulation.NAME):
        (tmp_path / name).touch()
    with emulation.registered():
        pass
    assert [words[0] for words in commands] == ["install"]


def test_base_image_is_keyed_by_architecture(tmp_path):
    assert base.key("arm64") != base.key()
    line = base.command(tmp_path / "base.tar", ["python3"], [], [], architecture="arm64")
    assert "--architectures=arm64" in line
