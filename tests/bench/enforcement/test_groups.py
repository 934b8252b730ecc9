"""What is written where, on plain files instead of the kernel's."""

import pytest

from tests.bench.enforcement.divisions import Setting
from tests.bench.enforcement.groups import Groups

NAMES = ("nav", "slam")


@pytest.fixture(params=[1, 2])
def version(request):
    return request.param


@pytest.fixture
def place(tmp_path, version):
    """Where the tasks' groups are."""
    if version == 2:
        (tmp_path / "cgroup.controllers").touch()
    found = tmp_path / ("cpu" if version == 1 else "") / "contextpolicy-enforcement" / "robot"
    for name in NAMES:
        (found / name).mkdir(parents=True)
    return found


@pytest.fixture
def groups(tmp_path, place):
    assert place.is_relative_to(tmp_path)
    return Groups(NAMES, tmp_path)


def written(group):
    return {file.name: file.read_text() for file in group.iterdir()}


def test_only_changed_settings_are_written(groups, place, version):
    groups.begin({name: Setting() for name in NAMES}, {})
    groups.apply({"nav": Setting(), "slam": Setting(shares=1628)}, {})
    assert written(place / "nav") == {}
    assert written(place / "slam") == ({"cpu.shares": "1628"} if version == 1 else {"cpu.weight": "63"})


def test_limit_is_set_and_removed(groups, place, version):
    groups.begin({name: Setting() for name in NAMES}, {})
    groups.apply({"slam": Setting(quota=250)}, {})
    limited = {"cpu.cfs_quota_us": "25000"} if version == 1 else {"cpu.max": "25000 100000"}
    assert written(place / "slam") == limited
    groups.apply({"slam": Setting()}, {})
    assert written(place / "slam") == ({"cpu.cfs_quota_us": "-1"} if version == 1 else {"cpu.max": "max 100000"})


def test_reset_clears_the_settings_of_the_previous_cell(groups, place, version):
    groups.begin({name: Setting(shares=2, quota=10) for name in NAMES}, {})
    groups.reset()
    expected = (
        {"cpu.shares": "1024", "cpu.cfs_quota_us": "-1"}
        if version == 1
        else {"cpu.weight": "39", "cpu.max": "max 100000"}
    )
    assert written(place / "nav") == written(place / "slam") == expected
