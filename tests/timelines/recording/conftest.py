from __future__ import annotations

import pytest

from timelines.demo.cgroup import Cgroup


@pytest.fixture
def cgroup(tmp_path):
    (tmp_path / "cpu.max").write_text("50000 100000")
    (tmp_path / "cpu.stat").write_text("usage_usec 2000000\nnr_periods 9\nnr_throttled 3\nthrottled_usec 500000")
    return Cgroup(tmp_path / "cpu.max", None, tmp_path / "cpu.stat")
