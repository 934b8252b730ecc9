import pytest
import zenoh
from hypothesis import given, reject
from hypothesis import strategies as st

from contextpolicy.simulation.keyexpr import includes

NAMES = st.sampled_from(["a", "b", "ab", "aab", "@a", "@", "a.b", "a::b_", "imu"])
WILDCARDS = st.sampled_from(["*", "**", "a$*", "$*a", "a$*b", "$*a$*", "@a$*"])


@pytest.mark.parametrize(
    ("expression", "key", "selected"),
    [
        ("robot/imu", "robot/imu", True),
        ("robot/*", "robot/imu", True),
        ("robot/*", "robot/imu/raw", False),
        ("robot/**", "robot", True),
        ("**/imu", "a/b/imu", True),
        ("robot/im$*", "robot/imu", True),
        ("robot/$*mu", "robot/mu", True),
        ("**", "a/@private", False),
        ("0/imu/data/sensor_msgs::msg::dds_::Imu_/*", "0/imu/data/sensor_msgs::msg::dds_::Imu_/RIHS01_x", True),
        ("robot.imu", "robot-imu", False),
    ],
)
def test_expression_selects_key(expression: str, key: str, selected: bool) -> None:  # noqa: FBT001
    assert includes(expression, key) is selected


@given(st.lists(st.one_of(NAMES, WILDCARDS), min_size=1, max_size=5), st.lists(NAMES, min_size=1, max_size=5))
def test_decides_as_zenoh(chunks: list[str], key: list[str]) -> None:
    try:
        expression = zenoh.KeyExpr.autocanonize("/".join(chunks))
    except zenoh.ZError:
        reject()
    assert includes(str(expression), "/".join(key)) is expression.intersects(zenoh.KeyExpr("/".join(key)))
