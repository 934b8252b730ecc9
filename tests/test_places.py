"""In how many places a change is made, tried on a copy of the sources: a field in two, a CEL function in one.

`make crds` writes the rest, and the tests of the copy find what was forgotten.
"""

from __future__ import annotations

import pytest

from tests.copied_sources import DEFINITION, Copy

FUNCTIONS = "operator/contextpolicy/policy/cel_functions.py"

IN_THE_DEFINITION = {
    DEFINITION: (
        "                    restartOnResize:\n",
        """\
                    pinned:
                      type: boolean
                      description: 'true to keep the task on its processors. Default: false.'
                    restartOnResize:
""",
    )
}
IN_THE_VALUE = {
    "operator/contextpolicy/policy/spec.py": (
        "    protected: bool = False\n",
        "    protected: bool = False\n    pinned: bool = False\n",
    ),
}
IN_THE_TABLE = {
    FUNCTIONS: (
        "OWN = (\n",
        '''\
def clamp(number: float, least: float, most: float) -> float:
    """The number, or the bound that it exceeds."""
    return max(least, min(number, most))


OWN = (
    Function(
        name="clamp",
        takes=((ValueKind.NUMBER,), (ValueKind.NUMBER,), (ValueKind.NUMBER,)),
        returns=ValueKind.NUMBER,
        meaning="the number kept between two others",
        example="clamp(imu.speed, 0.1, 0.3)",
        run=clamp,
    ),
''',
    )
}


@pytest.fixture
def copy(tmp_path):
    return Copy(tmp_path)


def test_a_field_is_added_to_the_definition_and_to_the_value(copy):
    assert "pinned" in copy.validate(task=", pinned: true")
    copy.edit(IN_THE_VALUE)
    forgotten = copy.failures("tests/crds/test_agreement.py", "-k", "agree_on_every_field")
    assert "spec.tasks[].pinned: the definition lacks it" in forgotten
    copy.edit(IN_THE_DEFINITION)
    assert len(copy.edited()) == 2
    copy.make_crds()
    assert copy.failures("tests/crds/test_agreement.py", "tests/crds/test_schema.py") == ""
    assert copy.validate(task=", pinned: true") == ""
    assert "true or false" in copy.validate(task=", pinned: maybe")


EVALUATE = """
from contextpolicy.planning.conditions.scope import Scope

scope = Scope()
expression = scope.compile("clamp(imu.speed, 0.1, 0.3) + size('abc')")
scope.bind("imu", {"speed": 0.5})
print(expression.evaluate(scope))
"""


def test_a_function_is_added_to_the_table(copy):
    assert "clamp" in copy.validate(when="clamp(imu.speed, 0.1, 0.3) > 0.2")
    copy.edit(IN_THE_TABLE)
    assert copy.edited() == {FUNCTIONS}
    assert "make crds" in copy.failures("tests/crds/test_schema.py", "-k", "function_table")
    copy.make_crds()
    assert copy.failures("tests/policy/test_cel_functions.py", "tests/crds/test_schema.py") == ""
    assert copy.python("-c", EVALUATE).stdout == "3.3\n"
    assert copy.validate(when="clamp(imu.speed, 0.1, 0.3) > 0.2") == ""
    assert "imu.frame is a string" in copy.validate(when="clamp(imu.frame, 0.1, 0.3) > 0.2")
    assert "such as clamp(imu.speed, 0.1, 0.3)" in copy.validate(when="clamp(imu.speed) > 0.2")
    assert "did you mean clamp?" in copy.validate(when="clmp(imu.speed, 0.1, 0.3) > 0.2")
    assert "is not a reserved word of CEL" in copy.validate(stream="clamp")
    assert "'clamp'" in (copy.folder / DEFINITION).read_text(encoding="utf-8")


def test_a_function_without_an_implementation_is_found(copy):
    copy.edit({FUNCTIONS: ("        run=root,\n", "")})
    assert "example_is_right_and_works[sqrt]" in copy.failures("tests/policy/test_cel_functions.py", "-k", "example")
