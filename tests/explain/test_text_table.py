"""Tables fit their reader's terminal and lose nothing on the way."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.explain.text_table import text_table, wrapped

HEAD = ("TIME", "CONTEXTS", "CAUSE")
ROWS = [("0.000", "-", "start"), ("10.100", "moving", "imu: context moving entered after a while")]


def drawn(width, **settings):
    return list(text_table(HEAD, ROWS, width, **settings))


def test_columns_are_as_wide_as_their_content():
    whole = [
        "  TIME  CONTEXTS  CAUSE",
        " 0.000  -         start",
        "10.100  moving    imu: context moving entered after a while",
    ]
    assert drawn(None, right={0}) == whole
    assert drawn(59, right={0}) == whole


def test_the_last_column_is_wrapped_first():
    assert drawn(40, right={0}) == [
        "  TIME  CONTEXTS  CAUSE",
        " 0.000  -         start",
        "10.100  moving    imu: context moving",
        "                  entered after a while",
    ]


def test_too_wide_table_becomes_paragraphs():
    assert drawn(36, indent="  ") == [
        "  0.000",
        "    CONTEXTS  -",
        "    CAUSE     start",
        "  10.100",
        "    CONTEXTS  moving",
        "    CAUSE     imu: context moving",
        "              entered after a while",
    ]


def test_numbers_at_the_end_are_not_wrapped():
    head, rows = ("TASK", "DROPPED", "QUEUE"), [("navigation-and-mapping", "100", "3.5")]
    assert list(text_table(head, rows, 30, right={1, 2})) == [
        "navigation-and-mapping",
        "  DROPPED  100",
        "  QUEUE    3.5",
    ]


def test_empty_cells_and_tables():
    assert list(text_table(HEAD, [], None)) == []
    assert list(text_table(("TASK", "", "SHARE"), [("slam", "", "1")], 8)) == ["slam", "  SHARE", "    1"]


CELLS = st.text(st.characters(categories=("L", "N")), max_size=30)


@given(rows=st.lists(st.tuples(CELLS, CELLS, CELLS), max_size=5), width=st.integers(40, 120))
def test_nothing_is_wider_than_the_terminal_and_nothing_is_lost(rows, width):
    lines = list(text_table(("A", "B", "C"), rows, width, right={1}))
    assert all(len(line) <= width for line in lines)
    reported = "".join("".join(lines).split())
    assert all(cell in reported for row in rows for cell in row)


@pytest.mark.parametrize("width", [None, 80])
def test_line_that_fits_is_unchanged(width):
    assert wrapped("set agent.enabled=true", width, "-> ", "   ") == ["-> set agent.enabled=true"]


def test_long_line_is_wrapped_between_words():
    assert wrapped("upgrade to 1.36, or set agent.enabled=true", 20, "-> ", "   ") == [
        "-> upgrade to 1.36,",
        "   or set",
        "   agent.enabled=true",
    ]


@pytest.mark.parametrize("width", [40, 60])
@pytest.mark.parametrize("longest", [10, 30, 63])
def test_long_headings_fit_too(width: int, longest: int) -> None:
    """A column of a simulation is headed by its task, whose name may have 63 characters."""
    heading = f"{'x' * longest} (WEIGHT)"
    lines = list(
        text_table(
            ["TIME", heading, "CAUSE"], [["1.000", "800m (8)", " ".join(map(str, range(50)))]], width, indent="  "
        )
    )
    assert [line for line in lines if len(line) > width] == []
    assert "800m (8)" in "\n".join(lines)
    assert max(lines.count(line) for line in lines) == 1, "no column of single letters"


@pytest.mark.parametrize("width", [None, 80])
def test_what_controls_a_terminal_is_not_printed(width):
    assert wrapped("seen:\x1b[2J\x9b", width) == ["seen:\ufffd[2J\ufffd"]
    assert list(text_table(("TASK",), [("slam\x1b[2J",)], width)) == ["TASK", "slam\ufffd[2J"]
