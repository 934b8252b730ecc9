from datetime import date
from pathlib import Path

from tests.soak.growth import MIB, Size
from tests.soak.page import HEADING, Soak, replaced, section

PAGE = Path(__file__).parents[2] / "docs" / "measurements" / "faults.md"
LIFE = [Size(0.0, 1, 34, 11, 98 * MIB), Size(1740.0, 1, 36, 12, 113 * MIB)]
SOAK = Soak(
    7, 3600, date(2026, 11, 24), 2, ["kine", "router", "kine"], ["flood"], lives={"operator": LIFE, "router": []}
)


def test_the_page_lists_events_and_measurements():
    text = section(SOAK)
    assert "`make soak SEED=7` for 3600 s on 2026-11-24, 2 cores" in text
    assert "(kine 2, router 1)" in text
    assert "(flood 1). No limit was ever wrong" in text
    assert "| operator, 29 minutes | 34 to 36 | 11 to 12 | 98 to 113 MiB |\n| router | too short a life" in text


def test_a_soak_that_failed_says_so():
    text = section(Soak(7, 3600, date(2026, 11, 24), 2, failed=["test_nothing_leaked"]))
    assert "**Failed: test_nothing_leaked.**" in text
    assert "never" not in text
    assert "No limit" not in text


def test_the_page_replaces_the_previous_soak():
    page = PAGE.read_text(encoding="utf-8")
    once = replaced(page, section(SOAK))
    assert once.count(HEADING) == 1
    assert "SEED=7" in once
    assert [line for line in page.splitlines() if line.startswith("## ")] == [
        line for line in once.splitlines() if line.startswith("## ")
    ]
    assert replaced(once, section(SOAK)) == once
