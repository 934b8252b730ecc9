"""The definition of ContextPolicy: complete as a manual, bounded for the API server, true to the samples."""

from __future__ import annotations

import re

import pytest
import yaml
from jsonschema import Draft7Validator

from contextpolicy.policy.cel_functions import LIBRARY, NAMES, OWN, Macro
from contextpolicy.policy.parsing import parse
from crds.__main__ import COPIES, PAGE, written
from crds.cel_page import page
from tests.crds.schema import DEFINITION, POLICIES, REFUSED, ROOT, definition, nodes, schema, strict, with_defaults

ALL_NODES = dict(nodes(schema()))


@pytest.fixture(params=POLICIES, ids=lambda path: path.stem)
def policy(request):
    return yaml.safe_load(request.param.read_text(encoding="utf-8"))


@pytest.mark.parametrize("folder", COPIES)
def test_a_copy_is_the_canonical_one(folder):
    assert (ROOT / folder / DEFINITION.name).read_bytes() == DEFINITION.read_bytes(), "run `make crds`"


def test_text_generated_from_the_function_table_is_up_to_date():
    text = DEFINITION.read_text(encoding="utf-8")
    assert text == written(text), "run `make crds`"
    assert all(
        f"{function.example}, {function.meaning}" in ALL_NODES["spec.streams"]["description"] for function in OWN
    )


def test_the_page_of_functions_is_up_to_date_and_has_them_all():
    text = PAGE.read_text(encoding="utf-8")
    assert text == page(), "run `make crds`"
    assert [one.example for one in (*OWN, *LIBRARY, *Macro) if f"`{one.example}`" not in text] == []


def test_the_definition_names_every_function():
    reported = ALL_NODES["spec.streams"]["description"]
    assert [name for name in NAMES if not re.search(rf"\b{name}\b", reported)] == []


@pytest.mark.parametrize("place", ["Besides CEL's own functions", "a name that is not a keyword"])
def test_missing_placeholder_is_an_error(place):
    with pytest.raises(LookupError, match="0 places"):
        written(DEFINITION.read_text(encoding="utf-8").replace(place, "something else"))


def test_kind_plural_and_short_name():
    names = definition()["spec"]["names"]
    assert (names["kind"], names["plural"], names["shortNames"]) == ("ContextPolicy", "contextpolicies", ["ctxp"])


def test_every_field_explains_itself():
    silent = [path for path, node in ALL_NODES.items() if not node.get("description")]
    assert silent == []


@pytest.mark.parametrize(("kind", "bound"), [("array", "maxItems"), ("string", "maxLength")])
def test_every_list_and_text_is_bounded(kind, bound):
    of_kind = {path: node for path, node in ALL_NODES.items() if node.get("type") == kind and "enum" not in node}
    unbounded = [path for path, node in of_kind.items() if bound not in node]
    assert of_kind
    assert set(unbounded) <= {"apiVersion", "kind"}


def test_every_map_and_quantity_is_bounded():
    maps = [node for node in ALL_NODES.values() if "additionalProperties" in node]
    quantities = [node for node in ALL_NODES.values() if node.get("x-kubernetes-int-or-string")]
    assert maps
    assert all("maxProperties" in node for node in maps)
    assert quantities
    assert all({"maxLength", "pattern", "minimum"} <= node.keys() for node in quantities)


def test_every_list_has_a_merge_strategy():
    assert [
        path for path, n in ALL_NODES.items() if n.get("type") == "array" and "x-kubernetes-list-type" not in n
    ] == []


def test_every_rule_says_what_is_expected():
    rules = [rule for node in ALL_NODES.values() for rule in node.get("x-kubernetes-validations", [])]
    assert rules
    assert [rule["rule"] for rule in rules if not rule.get("message", "").startswith("expected ")] == []


def test_every_rule_has_a_policy_that_it_refuses():
    expected = [path.read_text(encoding="utf-8").splitlines()[0].removeprefix("# expect: ") for path in REFUSED]
    rules = [rule for node in ALL_NODES.values() for rule in node.get("x-kubernetes-validations", [])]
    texts = [longest_text(rule) for rule in rules]
    assert [text for text in texts if not any(text in message or message in text for message in expected)] == []


def longest_text(rule):
    """The longest piece of a rule's message that stands there whatever the policy is."""
    literals = re.findall(r'"([^"]*)"', rule["messageExpression"]) if "messageExpression" in rule else [rule["message"]]
    return max((piece for literal in literals for piece in literal.split("%s")), key=len).strip(" ;:,")


def test_sample_policies_are_found():
    assert "delivery-robot" in [path.stem for path in POLICIES]


def test_a_sample_is_valid(policy):
    errors = [f"{error.json_path}: {error.message}" for error in Draft7Validator(strict(schema())).iter_errors(policy)]
    assert errors == []


def test_the_schemas_defaults_change_nothing(policy):
    stored = policy | {"spec": with_defaults(schema()["properties"]["spec"], policy["spec"])}
    assert stored != policy
    assert parse(stored) == parse(policy)


@pytest.mark.parametrize("path", REFUSED, ids=lambda path: path.stem)
def test_refused_policy_states_the_expected_message(path):
    first, *rest = path.read_text(encoding="utf-8").splitlines()
    assert first.startswith("# expect: ")
    assert yaml.safe_load("\n".join(rest))["metadata"]["name"] == path.stem
