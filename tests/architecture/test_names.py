"""Who searches for a module, a class, or the custom resource's name finds one."""

from __future__ import annotations

import ast
from collections import Counter

import pytest

from tests.architecture.source_code import OPERATOR, PACKAGE


def test_no_two_modules_share_a_name():
    names = [path.stem for path in PACKAGE.glob("**/*.py") if path.parent.name != "commands"]
    assert [name for name, count in Counter(names).items() if count > 1] == ["__init__"]


def test_no_two_public_classes_share_a_name():
    """A reader who searches for a class finds one."""
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.glob("**/*.py"))
    classes = (node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))
    assert [name for name, count in Counter(classes).items() if count > 1 and not name.startswith("_")] == []


def test_the_operator_folder_cannot_shadow_pythons_operator_module():
    assert not (OPERATOR / "__init__.py").exists()
    assert list(OPERATOR.glob("*.py")) == []


def spelt(source):
    """The texts of a module that spell the custom resource's version or plural."""
    texts = (node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant))
    return [text for text in texts if isinstance(text, str) and (text == "contextpolicies" or "licy.dev/v1" in text)]


@pytest.mark.parametrize("path", sorted(PACKAGE.glob("**/*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_the_custom_resource_is_spelt_in_one_place(path):
    if path.name != "custom_resource.py":
        assert spelt(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "planted",
    ["'contextpolicies'", "f'/apis/contextpolicy.dev/v1alpha1/namespaces/{name}'", "A = 'contextpolicy.dev/v1alpha1'"],
)
def test_another_spelling_of_the_custom_resource_is_found(planted):
    assert len(spelt(planted)) == 1
