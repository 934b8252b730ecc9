"""The generated reference pages are up to date and complete."""

from __future__ import annotations

import pytest

from contextpolicy.cli import IN_THE_CLUSTER, ON_THE_CLUSTER, ON_THE_DESK
from docs.generator import messages
from docs.generator.__main__ import PAGES, REFERENCE
from docs.generator.markdown import escaped
from docs.generator.values import rows
from tests.crds.schema import nodes, schema


@pytest.mark.parametrize("name", PAGES)
def test_generated_page_is_up_to_date(name):
    assert (REFERENCE / name).read_text(encoding="utf-8") == PAGES[name](), "make docs"


def test_every_field_has_a_row():
    page = PAGES["policy.md"]()
    fields = [path.rpartition(".")[2].removesuffix("[]") for path, _ in nodes(schema()) if "." in path]
    assert len(fields) > 100
    assert [name for name in fields if name != "*" and f"| `{name}`" not in page] == []


def test_tables_of_fields_can_be_scanned():
    """A long description stands below its table, where its first sentence is."""
    page = PAGES["policy.md"]()
    assert max(len(line) for line in page.splitlines() if line.startswith("| ")) < 750
    assert (
        "| `streams` (required) | list of objects |  | The sensor and module data that the policy reads. More below."
        in page
    )
    assert "\n**`streams`**: The sensor and module data that the policy reads. Each stream is a variable" in page


def test_each_rule_of_an_object_is_listed_once():
    for section in PAGES["policy.md"]().split("\n## ")[1:]:
        rules = [line for line in section.splitlines() if line.startswith("- ")]
        assert len(rules) == len(set(rules))


def test_every_command_shows_its_help():
    page = PAGES["commands.md"]()
    modules = {*ON_THE_CLUSTER, *ON_THE_DESK, *IN_THE_CLUSTER} - {"mode"}
    assert [name for name in modules if f"\n## {name.replace('_', '-')}\n" not in page] == []
    assert "\n## pause\n" in page


@pytest.mark.parametrize("chart", ["contextpolicy", "robot"])
def test_every_value_is_explained(chart):
    assert [path for path, _, meaning in rows(chart) if not meaning] == []


def test_bus_tables_have_every_field_once():
    page = messages.page()
    for cell in ("| `policy` |", "| `shortfalls` |", "| `run` |", "| `trigger` |", "| viewer |"):
        assert page.count(cell) == 1


def test_table_cells_escape_markdown():
    assert escaped("a|b `c|d<1` *e* [f] < 1\n\ng\nh") == r"a\|b `c\|d<1` \*e\* \[f\] &lt; 1<br><br>g h"
