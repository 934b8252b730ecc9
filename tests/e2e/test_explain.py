"""What the command line says of the operator is what the kernel does."""

import json

import pytest

from contextpolicy.cli import main
from tests.e2e.cluster import until
from timelines.demo.deploy import free_address

SHARES = {"slam": 990, "speech": 10}


@pytest.fixture(scope="module")
def endpoint():
    return f"tcp/{free_address(48)}:7447"


def test_top_reports_what_the_kernel_does(moving, endpoint, capsys):
    def shown():
        assert main(["top", "--connect", endpoint, "--once", "--output", "json"]) == 0
        lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        (policy,) = [line for line in lines if line["policy"] == "e2e-robot/robot"]
        return policy

    until("the node reports the limits", lambda: {t["stage"] for t in shown()["tasks"].values()} == {"inForce"})
    policy = shown()
    assert policy["contexts"] == ["moving"]
    assert {name: round(task["share"] * 1000) for name, task in policy["tasks"].items()} == moving.limits(*SHARES)
    assert [name for name, task in policy["tasks"].items() if task["suspended"]] == ["speech"]
