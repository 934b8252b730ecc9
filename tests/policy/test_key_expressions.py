import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.policy.key_expressions import excess, refusal, selects
from contextpolicy.policy.parsing import parse
from tests.planning.builders import a_body, a_task


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
    assert selects(expression, key) is selected


@pytest.mark.parametrize(
    ("key", "reason"),
    [
        ("robot/**/**", "`**/**` must be replaced by `**` to reach canon-form"),
        ("robot/**/*", "`**/*` must be replaced by `*/**` to reach canon-form"),
        ("robot/im*u", "`*` may only be preceded by `/` or `$`"),
        ("robot//imu", "empty chunks are forbidden, as well as leading and trailing slashes"),
        ("robot/#", "`#` and `?` are forbidden characters"),
        ("robot/\ud800", "it has characters that UTF-8 can't encode"),
    ],
)
def test_invalid_keys_are_reported_with_zenohs_message(key: str, reason: str) -> None:
    assert refusal(key) == reason
    assert_refused(key, reason)


@pytest.mark.parametrize("key", ["**/a/**", "robot/**/arm/**", "**/@adv/**", "a/**/b/**/c/**"])
def test_a_policys_keys_have_at_most_one_double_wildcard(key: str) -> None:
    """Zenoh tries every way to divide a key among several, and any sender may choose a long one."""
    assert refusal(key) == ""
    assert_refused(key, "`**` may occur once, as long keys would take too long to match")


def assert_refused(key: str, reason: str) -> None:
    body = a_body(
        streams=[{"name": "imu", "key": key}, {"name": "mic", "key": "mic", "liveliness": key}], tasks=[a_task("slam")]
    )
    with pytest.raises(PolicyError) as caught:
        parse(body)
    assert [finding.field for finding in caught.value.findings] == ["spec.streams[0].key", "spec.streams[1].liveliness"]
    assert {finding.value for finding in caught.value.findings} == {key}
    assert caught.value.findings[0].allowed.endswith(f"; {reason}")


@pytest.mark.parametrize("key", ["robot/*/imu/**", "robot/mic", "**"])
def test_good_key_expressions_are_not_refused(key: str) -> None:
    assert refusal(key) == excess(key) == ""
