"""A damaged rosbag2 is refused in one sentence, or read up to the damage."""

from __future__ import annotations

import shutil

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter

from contextpolicy.streams.recorded_message import RecordingError
from tests.streams.damaging import BEGIN, COUNT, SENTENCE, STEP, STORE, read, refusal


def bag(folder, plugin, count=COUNT):
    with BagWriter(folder, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/door", "std_msgs/msg/String", typestore=STORE)
        for index in range(count):
            text = STORE.types["std_msgs/msg/String"](f"{index:0>200}")
            payload = STORE.serialize_cdr(text, "std_msgs/msg/String")
            writer.write(connection, BEGIN + index * STEP, payload)
    return folder


@pytest.fixture(params=[StoragePlugin.SQLITE3, StoragePlugin.MCAP], ids=["sqlite3", "mcap"])
def a_bag(request, tmp_path):
    return bag(tmp_path / "bag", request.param)


def test_a_bag_without_metadata_suggests_reindexing(a_bag):
    assert read(a_bag) == (COUNT, [])
    (a_bag / "metadata.yaml").unlink()
    text = refusal(a_bag)
    assert "is a folder without metadata.yaml" in text
    assert f"{COUNT} messages were read" in text
    assert "`ros2 bag reindex`" in text
    assert read(a_bag, skip=True)[0] == COUNT


@pytest.mark.parametrize("text", ["", "{", "[]", "rosbag2_bagfile_information: 7", "rosbag2_bagfile_information: {}"])
def test_a_bag_with_broken_metadata_is_read_from_its_files(a_bag, text):
    (a_bag / "metadata.yaml").write_text(text)
    assert "has a metadata.yaml that can't be read" in refusal(a_bag)
    assert read(a_bag, skip=True)[0] == COUNT


def test_a_bag_whose_file_is_missing_names_it(a_bag):
    (storage,) = (path for path in a_bag.iterdir() if path.suffix != ".yaml")
    storage.rename(a_bag / f"other{storage.suffix}")
    assert f"names files which are not there: {storage.name}" in refusal(a_bag)
    assert read(a_bag, skip=True)[0] == COUNT


def test_a_bare_file_of_a_bag_is_read(a_bag):
    (storage,) = (path for path in a_bag.iterdir() if path.suffix != ".yaml")
    assert read(storage) == (COUNT, [])


def test_a_split_without_messages_is_not_damage(tmp_path):
    folder = bag(tmp_path / "bag", StoragePlugin.MCAP)
    bag(tmp_path / "empty", StoragePlugin.MCAP, count=0)
    shutil.move(tmp_path / "empty" / "empty.mcap", folder / "bag_1.mcap")
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("  - bag.mcap\n", "  - bag.mcap\n  - bag_1.mcap\n", 1))
    assert read(folder) == (COUNT, [])


def test_an_empty_last_split_is_damage(tmp_path):
    folder = bag(tmp_path / "bag", StoragePlugin.MCAP)
    (folder / "bag_1.mcap").write_bytes(b"")
    (folder / "metadata.yaml").unlink()
    assert "bag_1.mcap is empty" in refusal(folder, of=folder / "bag_1.mcap")
    count, notes = read(folder, skip=True)
    assert (count, len(notes)) == (COUNT, 2)


def test_a_damaged_database_is_read_up_to_the_damage(tmp_path):
    folder = bag(tmp_path / "bag", StoragePlugin.SQLITE3, 2000)
    (storage,) = folder.glob("*.db3")
    content = storage.read_bytes()
    storage.write_bytes(content[: len(content) // 2])
    text = refusal(storage)
    assert "`sqlite3 FILE .recover" in text
    assert SENTENCE.search(text) or "nothing was read" in text


def test_a_bag_without_messages_is_refused(tmp_path):
    assert "has no message" in refusal(bag(tmp_path / "bag", StoragePlugin.MCAP, count=0))


@settings(max_examples=60)
@given(at=st.floats(0, 1, exclude_max=True), byte=st.integers(0, 255), length=st.integers(1, 2000))
def test_arbitrary_database_damage_never_crashes_the_reader(tmp_path_factory, at, byte, length):
    folder = bag(tmp_path_factory.mktemp("fuzz") / "bag", StoragePlugin.SQLITE3, 50)
    (storage,) = folder.glob("*.db3")
    content = bytearray(storage.read_bytes())
    start = int(at * len(content))
    content[start : start + length] = bytes([byte]) * len(content[start : start + length])
    storage.write_bytes(content)
    for path in (storage, folder):
        try:
            read(path, skip=True)
        except RecordingError as error:
            assert str(error).startswith(str(folder))  # noqa: PT017 - either is right
