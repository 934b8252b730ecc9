from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modules.navigation.orders import STOP, parse_order, parse_ranges
from modules.navigation.pilot import DRIVE_PATIENCE, Drive
from modules.navigation.waypoints import Motion, Route
from robotkit import MessageError

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from(["stop", "waypoints", "drive", "ranges"]), inner),
)


def test_orders():
    assert parse_order(b'{"stop": true}', 0) == STOP
    assert parse_order(b'{"drive": {"forward": 0.1, "turn": -1}}', 2.0) == Drive(Motion(0.1, -1), 2.0 + DRIVE_PATIENCE)
    assert parse_order(b'{"drive": {"forward": 0.1}}', 0) == Drive(Motion(0.1, 0), DRIVE_PATIENCE)
    route = parse_order(b'{"waypoints": [[1, 2], [3, 4]]}', 0)
    assert isinstance(route, Route)
    assert route.left == 2


@pytest.mark.parametrize(
    ("payload", "problem"),
    [
        (b"\xff", "not JSON"),
        (b"{", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b"[]", r"order: invalid value b'\[\]': expected"),
        (b'{"stop": false}', r"order: invalid value b'\{.*\}': expected"),
        (b'{"drive": {"forward": "fast"}}', "forward: invalid value 'fast': expected a number from -0.5 to 0.5"),
        (b'{"drive": {"forward": 0.6}}', "forward: invalid value 0.6: expected a number from -0.5 to 0.5"),
        (b'{"drive": {"forward": NaN}}', "not JSON: NaN"),
        (b'{"drive": {"forward": 0, "turn": true}}', "turn: invalid value True: expected a number from -4 to 4"),
        (b'{"waypoints": [[1]]}', r"waypoints\[0\]: invalid value \[1\]: expected \[x, y\]"),
        (b'{"waypoints": [[1, 2], [1, 1e9]]}', r"waypoints\[1\]\[1\]: invalid value 1000000000.0: expected"),
        (json.dumps({"waypoints": [[0, 0]] * 1001}).encode(), "1001 of them: expected at most 1000"),
    ],
)
def test_an_invalid_order_is_reported(payload, problem):
    with pytest.raises(MessageError, match=problem):
        parse_order(payload, 0)


@pytest.mark.parametrize("payload", [b"{}", b'{"ranges": []}', b'{"ranges": [1, null]}', b'{"ranges": [-1]}', b"3"])
def test_an_invalid_scan_is_reported(payload):
    with pytest.raises(MessageError, match=r"scan: invalid value b'.*': expected `ranges`"):
        parse_ranges(payload)


@given(JSON)
def test_arbitrary_json_never_crashes_the_parsers(document):
    payload = json.dumps(document).encode()
    for parse in (lambda: parse_order(payload, 0), lambda: parse_ranges(payload)):
        try:
            parse()
        except MessageError:
            continue
