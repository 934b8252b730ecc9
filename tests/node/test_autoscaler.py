from pathlib import Path

import pytest

from tests.node import autoscaler, components, layout
from tests.node.test_components import flags

PARTS = (autoscaler.metrics_server(Path("/bin"), 10), *autoscaler.parts(Path("/bin"), 10))


def test_its_programs_are_not_node_components():
    names = [one.name for one in PARTS]
    assert names == ["metrics-server", "recommender", "updater", "admission-controller"]
    assert not {*names} & {*components.names()}


@pytest.mark.parametrize("part", PARTS, ids=lambda one: one.name)
def test_every_file_that_a_program_names_is_below_the_root(part):
    paths = [value for value in flags(part).values() if value.startswith("/")]
    assert paths
    assert all(path.startswith(f"{layout.ROOT}/") for path in paths)


def test_metrics_resolution_has_a_minimum_of_ten_seconds():
    assert flags(autoscaler.metrics_server(Path("/bin"), 5))["metric-resolution"] == "10s"
