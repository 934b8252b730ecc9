"""CPU weights in the kernel's units."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.agent import weight_units as units

VERSIONS = (1, 2)


@pytest.mark.parametrize(
    ("millicores", "version", "pod", "container"),
    [
        (0, 1, 2, 2),
        (0, 2, 1, 1),
        (10, 1, 10, 10),
        (10, 2, 1, 4),
        (25, 2, 1, 6),
        (50, 2, 2, 11),
        (1000, 1, 1024, 1024),
        (1000, 2, 39, 100),
        (1050, 2, 41, 104),
        (256_000, 1, 262_144, 262_144),
        (256_000, 2, 10_000, 10_000),
        (10**9, 1, 262_144, 262_144),
        (10**9, 2, 10_000, 10_000),
    ],
)
def test_weights_match_those_of_kubelet_and_runtime(millicores, version, pod, container):
    assert units.of_pod(millicores, version) == pod
    assert units.of_container(millicores, version) == container


@given(st.integers(1, 300_000), st.integers(1, 300_000), st.sampled_from(VERSIONS))
def test_weight_is_monotonic_in_the_request(one, other, version):
    less, more = sorted((one, other))
    assert units.of_pod(less, version) <= units.of_pod(more, version)
    assert units.of_container(less, version) <= units.of_container(more, version)


@given(st.integers(10, 200_000), st.sampled_from(VERSIONS))
def test_container_weight_converts_back_to_the_request(millicores, version):
    back = units.millicores(units.of_container(millicores, version), version)
    assert abs(back - millicores) <= max(6, millicores * 0.07)


@given(st.integers(30, 200_000))
def test_linear_weight_converts_back_to_a_request_of_the_same_weight(millicores):
    back = units.millicores(units.of_container(millicores, 2, linear=True), 2, linear=True)
    assert abs(back - millicores) <= 14
    assert units.of_pod(back, 2) == units.of_pod(millicores, 2)


@pytest.mark.parametrize(
    ("weight", "millicores", "linear"),
    [(20, 500, True), (59, 500, False), (21, 500, None), (1, 0, None), (1, 10, True), (4, 10, False)],
)
def test_a_weight_of_a_known_request_shows_the_conversion(weight, millicores, linear):
    assert units.is_linear(weight, millicores) is linear


@given(st.integers(0, 10**12), st.sampled_from(VERSIONS))
def test_the_kernel_takes_every_weight(millicores, version):
    for weight in (units.of_pod(millicores, version), units.of_container(millicores, version)):
        assert units.LEAST[version] <= weight <= units.MOST[version]


@pytest.mark.parametrize("version", VERSIONS)
def test_an_idle_group_has_no_weight(version):
    """`cpu.idle`, which some set for batch pods, shows as 0 under version 2."""
    assert units.millicores(0, version) == 0
