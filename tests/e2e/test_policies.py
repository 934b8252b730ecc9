"""`kubectl apply` refuses what makes no sense, in words that a person can act on."""

import re
from pathlib import Path

import pytest
import yaml

from tests.e2e.cluster import CommandError, run

FOLDER = Path(__file__).parent / "bad_policies"
BAD = sorted(FOLDER.glob("*.yaml"))
CONFIG = Path(__file__).parents[2] / "config"
GOOD = [*sorted((CONFIG / "policies").glob("*.yaml")), CONFIG / "ros2-node" / "policy.yaml"]
ONE_ERROR = re.compile(r"^(?=Error from server)", flags=re.MULTILINE)


@pytest.fixture(scope="module")
def refusals(operator):  # noqa: ARG001 - the definition comes with it
    """What kubectl says of each bad policy, by its name: all of them in one call, which goes on after an error."""
    with pytest.raises(CommandError) as refused:
        run("kubectl", "apply", "--dry-run=server", "-f", str(FOLDER))
    said = ONE_ERROR.split(str(refused.value))
    return {path.stem: "".join(one for one in said if f'/{path.name}"' in one) for path in BAD}


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_bad_policy_is_refused(refusals, path):
    expected = path.read_text().splitlines()[0].removeprefix("# expect: ")
    assert expected in refusals[path.stem]


@pytest.mark.usefixtures("operator")
def test_sample_policies_are_accepted():
    policies = [yaml.safe_load(path.read_text()) for path in GOOD]
    for policy in policies:
        policy["metadata"]["namespace"] = "e2e-robot"
    run("kubectl", "apply", "--dry-run=server", "-f", "-", stdin=yaml.safe_dump_all(policies))


@pytest.mark.usefixtures("operator")
def test_the_deployment_of_a_plain_ros_node_is_accepted():
    objects = list(yaml.safe_load_all((CONFIG / "ros2-node" / "node.yaml").read_text()))
    for one in objects:
        one["metadata"]["namespace"] = "e2e-robot"
    run("kubectl", "apply", "--dry-run=server", "--validate=strict", "-f", "-", stdin=yaml.safe_dump_all(objects))


def test_the_image_validates_files_as_the_api_server_does(operator):
    """Its copy of the definition is inside; without it `validate` could only parse."""
    validate = ("kubectl", "exec", "-i", "-n", operator, "deploy/e2e", "--", "contextpolicy")
    run(*validate, "validate", "-", stdin=GOOD[0].read_text())
    bad = next(path for path in BAD if path.stem == "stale-after-nothing")
    with pytest.raises(CommandError, match="expected a duration above 0"):
        run(*validate, "validate", "-", stdin=bad.read_text())


@pytest.mark.usefixtures("operator")
def test_explain_reads_like_a_manual():
    text = run("kubectl", "explain", "ctxp.spec.tasks.activity")
    assert "score" in text
    assert len(text) > 500
