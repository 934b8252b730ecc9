from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from contextpolicy.cli import main

ROOT = Path(__file__).parents[2]
POLICIES = ROOT / "config/policies"
BAD = ROOT / "tests/e2e/bad_policies"


def test_valid(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(POLICIES / "delivery-robot.yaml")]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "1 policy, 0 errors, 0 warnings\n"


def test_an_error_has_file_line_column_field_value_and_what_is_allowed(capsys: pytest.CaptureFixture[str]) -> None:
    path = BAD / "mode-misspelt.yaml"
    assert main(["validate", str(path)]) == 1
    out, err = capsys.readouterr()
    line = next(n for n, text in enumerate(path.read_text().splitlines(), start=1) if text.startswith("  mode"))
    allowed = "one of Enforce, DryRun, Paused"
    assert out == f"{path}:{line}:3: error: spec.mode: 'Dryrun' is not allowed: {allowed}\n"
    assert err == "1 policy, 1 error, 0 warnings\n"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("kind: ContextPolcy", "kind: 'ContextPolcy' is not allowed: ContextPolicy"),
        ("kind: contextpolicies", "kind: 'contextpolicies' is not allowed: ContextPolicy"),
        ("kind: Deployment", "kind: 'Deployment' is not allowed: ContextPolicy"),
        ("", "kind: is missing: ContextPolicy"),
    ],
)
def test_a_misspelt_kind_is_an_error(
    wrong: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Skipped, the policy would pass as checked beside another one."""
    path = tmp_path / "policies.yaml"
    text = (POLICIES / "delivery-robot.yaml").read_text()
    path.write_text(f"{text}\n---\n{text.replace('kind: ContextPolicy', wrong)}")
    assert main(["validate", str(path)]) == 1
    assert message in capsys.readouterr().out


def test_a_directory_and_what_is_skipped_in_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/pod.yaml").write_text("kind: Pod\n")
    (tmp_path / "values.yml").write_text("- 1\n")
    (tmp_path / "policy.yaml").write_text((POLICIES / "delivery-robot.yaml").read_text())
    assert main(["validate", str(tmp_path)]) == 0
    assert capsys.readouterr().err.splitlines() == [
        f"skipped: {tmp_path}/sub/pod.yaml:1: no ContextPolicy: kind Pod",
        f"skipped: {tmp_path}/values.yml:1: no ContextPolicy: not a Kubernetes object",
        "1 policy, 0 errors, 0 warnings",
    ]


def test_standard_input(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("kind: ContextPolicy\n"))
    assert main(["validate", "-"]) == 1
    assert "<stdin>:1:1: error: apiVersion: is missing: contextpolicy.dev/v1alpha1\n" in capsys.readouterr().out


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "--output", "json", str(BAD / "min-above-max.yaml")]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["valid"] is False
    (problem,) = document["problems"]
    assert problem["severity"] == "error"
    assert (problem["field"], problem["value"]) == ("spec.tasks[0].max", "500m")
    assert problem["line"] > 1


def test_nothing_found_is_not_valid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(tmp_path)]) == 1
    assert capsys.readouterr().err == "no ContextPolicy found\n"


def test_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "nowhere.yaml"]) == 2
    assert "nowhere.yaml" in capsys.readouterr().err


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_bytes(b"\xff\xfe\xfa")
    assert main(["validate", str(tmp_path / "x.yaml")]) == 2
