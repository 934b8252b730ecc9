"""What is refused while a policy is read."""

from __future__ import annotations

import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.policy import parsing
from tests.planning.builders import a_body, a_task


def refused(**spec):
    """The findings for a spec, as {field: (value, allowed)}."""
    spec.setdefault("tasks", [a_task("slam")])
    with pytest.raises(PolicyError) as caught:
        parsing.parse(a_body(**spec))
    return {finding.field: (finding.value, finding.allowed) for finding in caught.value.findings}
