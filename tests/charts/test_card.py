"""What the chart says of itself to those who look for one."""

from __future__ import annotations

import base64
from xml.etree import ElementTree as ET

import yaml

from contextpolicy.policy.validation.check import check
from tests.charts.conftest import CHART
from tests.crds.schema import definition

CARD = yaml.safe_load((CHART / "Chart.yaml").read_text(encoding="utf-8"))


def test_chart_metadata_is_complete_for_artifact_hub():
    assert {"home", "maintainers", "icon", "keywords", "description"} <= CARD.keys()
    said = {name.removeprefix("artifacthub.io/"): yaml.safe_load(text) for name, text in CARD["annotations"].items()}
    assert said["category"] in ARTIFACT_HUB_CATEGORIES
    assert said["operatorCapabilities"] in ARTIFACT_HUB_CAPABILITIES
    names = definition()["spec"]["names"]
    versions = [version["name"] for version in definition()["spec"]["versions"]]
    assert [(crd["kind"], crd["name"]) for crd in said["crds"]] == [(names["kind"], definition()["metadata"]["name"])]
    assert [crd["version"] for crd in said["crds"]] == versions
    [example] = said["crdsExamples"]
    assert check([("example", yaml.safe_dump(example))]).errors == []


def test_the_icon_needs_no_network():
    kind, picture = CARD["icon"].split(";base64,")
    assert kind == "data:image/svg+xml"
    assert ET.fromstring(base64.b64decode(picture)).tag.endswith("}svg")  # noqa: S314 - ours


ARTIFACT_HUB_CATEGORIES = {
    *("ai-machine-learning", "database", "integration-delivery", "monitoring-logging", "networking", "security"),
    *("storage", "streaming-messaging", "skip-prediction"),
}
ARTIFACT_HUB_CAPABILITIES = {"Basic Install", "Seamless Upgrades", "Full Lifecycle", "Deep Insights", "Auto Pilot"}
