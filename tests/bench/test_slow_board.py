import pytest

from tests.bench.slow_board import rating

PRINTED = """
7-Zip (r) 26.02 (x64)

22:       3302   100   3213   3213  |      47411   100   4048   4048
----------------------------------  | ------------------------------
Avr:             100   3213   3213  |              100   4048   4048
Tot:             100   3631   3630
"""


def test_the_rating_is_the_total_of_compressing_and_decompressing():
    assert rating(PRINTED) == 3630


def test_benchmark_without_a_total_is_an_error():
    with pytest.raises(ValueError, match="no total in what 7zr printed: 'Error: no memory"):
        rating("Error: no memory")
