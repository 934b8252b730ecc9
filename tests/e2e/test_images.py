"""The images as pods start them: what they hold is ready to run."""

import re

import pytest

from tests.node import images
from tests.node.layout import REPOSITORY

MODULES = sorted(path.parent.name for path in (REPOSITORY / "modules").glob("*/Dockerfile"))
STARTS = {
    "contextpolicy": ("/opt/contextpolicy", "kopf, contextpolicy.app.supervisor, contextpolicy.agent.agent"),
    **{f"contextpolicy-{module}": ("/opt/module", "asyncio, email, robotkit") for module in MODULES},
}
"""Where each image has its Python, and what it imports at its start."""


@pytest.mark.parametrize("image", STARTS)
def test_no_start_compiles_a_library(image):
    """There is nowhere to keep what was compiled: the root file system is read-only."""
    folder, imported = STARTS[image]
    start = f"{folder}/bin/python -v -c 'import {imported}' 2>&1"
    said = images.run(images.reference(image), ["sh", "-c", start], folders=[], timeout=60)
    assert "import 'asyncio'" in said
    assert re.findall(r"^# code object from (/\S+\.py)$", said, flags=re.MULTILINE) == []
