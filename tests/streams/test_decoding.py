"""Payloads of untrusted senders: JSON, CBOR and MessagePack."""

from __future__ import annotations

import json
import math

import cbor2
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from contextpolicy.streams.decoding import MAX_DEPTH, MAX_PAYLOAD, MAX_VALUES
from tests.streams.payloads import READING, WRITERS, decode, refused


@pytest.fixture(params=WRITERS)
def encoding(request):
    return request.param


class TestPlainEncodings:
    def test_a_map_is_the_samples_fields(self, encoding):
        sample = decode(WRITERS[encoding](READING), encoding)
        assert (sample.stream, sample.value, sample.timestamp) == ("imu", READING, None)

    @pytest.mark.parametrize("value", [3.5, "text", [1, 2], None, True])
    def test_a_non_map_sample_is_read_as_value(self, encoding, value):
        assert decode(WRITERS[encoding](value), encoding).value == {"value": value}

    def test_payloads_are_limited_to_one_mebibyte(self, encoding):
        around = 2 if encoding == "json" else 5  # bytes beside those of the text
        text = "a" * (1024 * 1024 - around)
        assert decode(WRITERS[encoding](text), encoding).value == {"value": text}
        assert refused(b" " * 1_048_577, encoding).endswith("has 1048577 bytes: expected at most 1048576")

    def test_depth_is_bounded(self, encoding):
        value: object = 1
        for _ in range(MAX_DEPTH):
            value = [value]
        assert decode(WRITERS[encoding](value), encoding).value == {"value": value}
        assert "nests deeper" in refused(WRITERS[encoding]([value]), encoding)

    @pytest.mark.parametrize(
        "shape", [list, lambda items: {str(n): n for n in items}, lambda items: [[n] for n in items]]
    )
    def test_the_number_of_values_is_bounded(self, encoding, shape):
        assert "more than 10000 values" in refused(WRITERS[encoding](shape(range(MAX_VALUES))), encoding)

    def test_a_laser_scan_is_within_bounds(self, encoding):
        scan = {"ranges": [1.5] * 1440, "intensities": [0.5] * 1440}
        assert decode(WRITERS[encoding](scan), encoding).value == scan

    @pytest.mark.parametrize("cut", [0, 1, 5, 30])
    def test_a_truncated_payload(self, encoding, cut):
        refused(WRITERS[encoding](READING)[:cut], encoding)


def finite(number):
    return float(number) if math.isfinite(float(number)) else 1 / 0


class TestJson:
    @pytest.mark.parametrize("text", ["", "{", "nope", "{'a': 1}", "[1,]", '{"a": 1} x', "\ufeff{}"])
    def test_invalid_json_is_refused(self, text):
        refused(text.encode())

    @pytest.mark.parametrize("constant", ["NaN", "Infinity", "-Infinity"])
    def test_nan_and_infinity_are_refused_in_json(self, constant):
        assert f"holds {constant}" in refused(f'{{"a": {constant}}}'.encode())

    def test_invalid_utf8_is_refused(self):
        refused(b'{"a": "\xff"}')

    def test_a_bomb_of_brackets(self):
        refused(b"[" * MAX_PAYLOAD)
        refused(b'{"a":' * 200_000)

    @pytest.mark.parametrize("number", ["1e400", "-1e400", "2.5E+309"])
    def test_a_number_beyond_all_doubles(self, number):
        assert f"holds '{number}', which is larger than any double" in refused(f'{{"a": [{number}]}}'.encode())
        assert decode(b"1e308").value == {"value": 1e308}

    def test_numbers_of_too_many_digits_are_refused(self):
        refused(b"1" * 5000)
        assert decode(b"1" * 400).value == {"value": int("1" * 400)}

    @given(
        st.binary(max_size=40) | st.text(alphabet='{}[]",:0123456789.eE+-truefalsn\\ud8 ', max_size=30).map(str.encode)
    )
    @example(b'{"a": 1, "a": 2}')
    @example(b"18446744073709551616")
    @example(b"1e400")
    @example(b"-0.0")
    @example(rb'"\ud800"')
    @example(rb'{"a": "\ud83d\ude00\u0000"}')
    def test_it_is_read_as_the_standard_library_reads_it(self, payload):
        """Whatever reads it first: the same values of the same types, or no sample."""
        try:
            value = json.loads(payload.decode(), parse_constant=lambda _: 1 / 0, parse_float=finite)
        except (ValueError, ZeroDivisionError):
            refused(payload)
        else:
            fields = value if isinstance(value, dict) else {"value": value}
            assert repr(decode(payload).value) == repr(fields)

    def test_brackets_in_a_text_do_not_count_as_depth(self):
        assert decode(b'{"a": "' + b"[" * 1000 + b'"}').value == {"a": "[" * 1000}


class TestCbor:
    @pytest.mark.parametrize(
        ("payload", "why"),
        [
            pytest.param(b"\xf7", "UndefinedType", id="undefined"),
            pytest.param(b"\xc1\x1a\x65\x00\x00\x00", "datetime", id="date"),
            pytest.param(b"\xc4\x82\x1b\x00\x00\x00\x10\x00\x00\x00\x00\x01", "Decimal", id="huge decimal"),
            pytest.param(b"\xd8\x23\x64(a*)", "Pattern", id="regular expression"),
            pytest.param(b"\xa1\x01\x02", "has the key 1", id="key is a number"),
            pytest.param(b"\xa1\x81\x01\x02", "has the key (1,)", id="key is a list"),
            pytest.param(b"\xd8\x1c\x81\xd8\x1d\x00", "tag 29", id="a list that holds itself"),
            pytest.param(b"\x82\xd8\x1c\x61a\xd8\x1d\x00", "tag 28", id="value sharing"),
            pytest.param(b"\xd8\x1d\x00", "tag 29", id="reference to a value"),
            pytest.param(b"\xd9\x01\x00\x82\x64abcd\xd8\x19\x00", "tag 25", id="text said once"),
            pytest.param(b"\xd9\x01\x00\x64abcd", "tag 256", id="namespace of texts"),
            pytest.param(b"\x9b\x00\x00\x00\x10\x00\x00\x00\x00", "premature end", id="claims 2^36 items"),
            pytest.param(b"\x5b\x00\x00\x00\x10\x00\x00\x00\x00", "premature end", id="claims 2^36 bytes"),
            pytest.param(b"\x62\xff\xff", "is malformed", id="text is no UTF-8"),
        ],
    )
    def test_non_readings_are_refused(self, payload, why):
        assert why in refused(payload, "cbor")

    @pytest.mark.parametrize("size", [100, 900_000])
    def test_shared_references_are_refused(self, size):
        """A payload below 1 MiB would become a value of 900 MB where it is copied."""
        payload = cbor2.dumps(["x" * size] * 1000, value_sharing=True, string_referencing=True)
        assert "expected numbers, strings, lists and maps" in refused(payload, "cbor")
        shared = b"\x99\x03\xe9\xd8\x1c" + cbor2.dumps("x" * size) + b"\xd8\x1d\x00" * 1000
        assert "expected numbers, strings, lists and maps" in refused(shared, "cbor")

    def test_nan_and_infinities_are_values(self):
        values = decode(cbor2.dumps([float("inf"), float("nan")]), "cbor").value["value"]
        assert values[0] == float("inf")
        assert values[1] != values[1]


class TestMsgpack:
    @pytest.mark.parametrize(
        "payload",
        [b"\xdd\xff\xff\xff\xff", b"\x81\x01\x02", b"\xc7\x01\x05a", b"\x91" * 2000, b"\xc1", b"\xa2\xff\xff"],
    )
    def test_non_readings_are_refused(self, payload):
        refused(payload, "msgpack")
