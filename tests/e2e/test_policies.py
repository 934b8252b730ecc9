"""`kubectl apply` refuses what makes no sense, in words that a person can act on."""

import re
from pathlib import Path

import pytest
import yaml

from tests.e2e.cluster import CommandError, run

BAD = sorted((Path(__file__).parent / "bad_policies").glob("*.yaml"))
GOOD = sorted((Path(__file__).parents[2] / "config" / "policies").glob("*.yaml"))


def test_there_are_policies_to_try():
    assert len(BAD) >= 25
    assert GOOD


@pytest.mark.usefixtures("operator")
@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_bad_policy_is_refused(path):
    expected = path.read_text().splitlines()[0].removeprefix("# expect: ")
    with pytest.raises(CommandError, match=re.escape(expected)):
        run("kubectl", "apply", "--dry-run=server", "-f", str(path))


@pytest.mark.usefixtures("operator")
@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.stem)
def test_sample_policy_is_accepted(path):
    policy = yaml.safe_load(path.read_text())
    policy["metadata"]["namespace"] = "e2e-robot"
    run("kubectl", "apply", "--dry-run=server", "-f", "-", stdin=yaml.safe_dump(policy))


def test_the_image_validates_files_as_the_api_server_does(operator):
    """Its copy of the definition is inside; without it `validate` could only parse."""
    validate = ("kubectl", "exec", "-i", "-n", operator, "deploy/e2e", "--", "contextpolicy")
    run(*validate, "validate", "-", stdin=GOOD[0].read_text())
    bad = next(path for path in BAD if path.stem == "stale-after-nothing")
    with pytest.raises(CommandError, match="must be longer than 0s"):
        run(*validate, "validate", "-", stdin=bad.read_text())


@pytest.mark.usefixtures("operator")
def test_explain_reads_like_a_manual():
    text = run("kubectl", "explain", "ctxp.spec.tasks.activity")
    assert "score" in text
    assert len(text) > 500
