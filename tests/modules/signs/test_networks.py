"""Where the networks come from, and the errors when they are missing."""

from __future__ import annotations

import pytest

from modules.signs import networks
from modules.signs.networks import DETECTION, RECOGNITION, Networks, find, metadata
from robotkit import ConfigurationError


def test_the_installed_package_brings_both():
    assert find("").detection().getLayerNames()
    network, characters = find("").recognition()
    assert network.getLayerNames()
    assert len(characters) > 10_000
    assert {"0", "9", "A"} <= set(characters)


def test_without_the_package_it_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr(networks, "find_spec", lambda _: None)
    with pytest.raises(ConfigurationError, match=r"rapidocr is not installed \(pip install --no-deps"):
        find("")


def test_a_missing_network_is_reported_with_its_path(tmp_path):
    with pytest.raises(ConfigurationError, match=f"{DETECTION} is missing: SIGNS_MODELS"):
        find(str(tmp_path)).detection()


@pytest.mark.parametrize("content", [b"", b"garbage", b"\x08\x07" * 50])
def test_a_broken_network_is_reported_with_its_path(tmp_path, content):
    (tmp_path / DETECTION).write_bytes(content)
    with pytest.raises(ConfigurationError, match=f"{DETECTION} is not a network that OpenCV can read"):
        Networks(tmp_path).detection()


def entry(key, value):
    def text(number, content):
        return bytes([number << 3 | 2, len(content)]) + content

    inside = text(1, key.encode()) + text(2, value.encode())
    return text(14, inside)


def test_metadata_among_other_fields(tmp_path):
    version, producer, opset = b"\x08\x0a", b"\x12\x04test", b"\x42\x04\x0a\x00\x10\x0b"
    path = tmp_path / RECOGNITION
    path.write_bytes(version + producer + entry("character", "a\nb") + opset + entry("note", "x"))
    assert metadata(path) == {"character": "a\nb", "note": "x"}


@pytest.mark.parametrize("content", [b"\xff" * 20, b"\x72\x05\x0a", b"\x72\x03\x0a\x01k"])
def test_broken_metadata_is_reported_with_its_path(tmp_path, content):
    path = tmp_path / RECOGNITION
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=f"{RECOGNITION} does not list the characters"):
        metadata(path)
