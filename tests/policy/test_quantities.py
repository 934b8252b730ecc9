from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.policy.quantities import format_cpu, parse_cpu, parse_duration, parse_memory

NONSENSE: list[object] = [
    None,
    True,
    "",
    " ",
    "1 ",
    "-1",
    "1e3",
    "m",
    "1.2.3",
    "NaN",
    "inf",
    [],
    {},
    float("nan"),
    float("inf"),
    "٣",
]


@pytest.mark.parametrize(
    ("raw", "millis"), [("300m", 300), ("2", 2000), (2, 2000), (0.5, 500), ("1.505", 1505), ("0", 0)]
)
def test_cpu(raw, millis):
    assert parse_cpu(raw) == millis


@pytest.mark.parametrize("raw", [*NONSENSE, "1.5555", "300M", 1e-7, -1, "1s", 10**12])
def test_invalid_cpu_quantities(raw):
    with pytest.raises(ValueError, match="CPU quantity"):
        parse_cpu(raw)


@pytest.mark.parametrize(
    ("raw", "size"),
    [("100Mi", 100 << 20), ("1Gi", 1 << 30), ("1k", 1000), ("1Ki", 1024), ("1.5G", 1_500_000_000), (4096, 4096)],
)
def test_memory(raw, size):
    assert parse_memory(raw) == size


@pytest.mark.parametrize("raw", [*NONSENSE, "1mi", "1KB", "1Kii", "ki"])
def test_invalid_memory_quantities(raw):
    with pytest.raises(ValueError, match="memory quantity"):
        parse_memory(raw)


@pytest.mark.parametrize(
    ("raw", "seconds"),
    [("500ms", 0.5), ("1.5s", 1.5), ("1m30s", 90.0), ("2h", 7200.0), ("0s", 0.0), ("1h0.5s", 3600.5)],
)
def test_duration(raw, seconds):
    assert parse_duration(raw) == seconds


@pytest.mark.parametrize("raw", [*NONSENSE, 5, 1.5, "5", "1 s", "1d", "-1s", "s", "1s1", "1.s", ".5s"])
def test_invalid_durations(raw):
    with pytest.raises(ValueError, match="a duration"):
        parse_duration(raw)


@given(st.integers(0, 10**6))
def test_formatted_cpu_values_round_trip(millis):
    assert parse_cpu(format_cpu(millis)) == millis


@given(st.one_of(st.text(max_size=20), st.integers(), st.floats(), st.none(), st.booleans()))
def test_arbitrary_input_raises_only_value_errors(raw):
    for parse in (parse_cpu, parse_memory, parse_duration):
        try:
            assert parse(raw) >= 0
        except ValueError:
            continue
