"""The stand-in for the API server does as it does where the resizer depends on it."""

from tests.actuators.resize.fake_cluster import FakeCluster
from tests.cluster.builders import a_pod
from tests.policies.builders import resources


def test_a_value_has_one_owner_however_often_it_changes():
    cluster = FakeCluster(a_pod("slam", {"slam": resources()}))
    for limit, by in ((600, "vpa"), (700, "kubectl"), (800, "vpa")):
        cluster.edit("uid-slam", "slam", by=by, cpu=f"{limit}m")
    owners = [entry["manager"] for entry in cluster.pods["uid-slam"]["metadata"]["managedFields"]]
    assert owners == ["vpa"]
