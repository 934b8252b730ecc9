from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from contextpolicy.cli import main

ROOT = Path(__file__).parents[2]
POLICIES = ROOT / "config/policies"
BAD = ROOT / "tests/e2e/bad_policies"


def test_an_error_has_file_line_column_field_value_and_what_is_allowed(capsys: pytest.CaptureFixture[str]) -> None:
    path = BAD / "mode-misspelt.yaml"
    assert main(["validate", str(path)]) == 1
    out, err = capsys.readouterr()
    line = next(n for n, text in enumerate(path.read_text().splitlines(), start=1) if text.startswith("  mode"))
    allowed = "one of Enforce, DryRun, Paused"
    assert out == f"{path}:{line}:3: error: spec.mode: invalid value 'Dryrun': expected {allowed}\n"
    assert err == "1 policy, 1 error, 0 warnings\n"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("kind: ContextPolcy", "kind: invalid value 'ContextPolcy': expected ContextPolicy"),
        ("kind: contextpolicies", "kind: invalid value 'contextpolicies': expected ContextPolicy"),
        ("kind: Deployment", "kind: invalid value 'Deployment': expected ContextPolicy"),
        ("", "kind: missing: expected ContextPolicy"),
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


def test_an_unknown_field_is_reported_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its value is not what is wrong."""
    path = tmp_path / "policy.yaml"
    path.write_text((POLICIES / "delivery-robot.yaml").read_text().replace("  reserve:", "  reserv:"))
    assert main(["validate", str(path)]) == 1
    (error,) = capsys.readouterr().out.splitlines()
    assert "error: spec.reserv: unknown field: expected one of the fields " in error
    assert error.endswith("; did you mean reserve?")


def test_directory_is_searched_and_other_files_are_skipped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/pod.yaml").write_text("kind: Pod\n")
    (tmp_path / "values.yml").write_text("- 1\n")
    (tmp_path / "policy.yaml").write_text((POLICIES / "delivery-robot.yaml").read_text())
    assert main(["validate", str(tmp_path)]) == 0
    assert capsys.readouterr().err.splitlines() == [
        f"skipped: {tmp_path}/sub/pod.yaml:1: not a ContextPolicy: kind Pod",
        f"skipped: {tmp_path}/values.yml:1: not a ContextPolicy: not a Kubernetes object",
        "1 policy, 0 errors, 0 warnings",
    ]


def test_standard_input(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("kind: ContextPolicy\n"))
    assert main(["validate", "-"]) == 1
    assert "<stdin>:1:1: error: apiVersion: missing: expected contextpolicy.dev/v1alpha1\n" in capsys.readouterr().out


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "--output", "json", str(BAD / "min-above-max.yaml")]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["valid"] is False
    (problem,) = document["problems"]
    assert problem["severity"] == "error"
    assert (problem["field"], problem["value"]) == ("spec.tasks[0].max", "500m")
    assert problem["line"] > 1


def test_directory_without_policies_is_not_valid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(tmp_path)]) == 1
    assert capsys.readouterr().err == "no ContextPolicy found\n"


def test_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "nowhere.yaml"]) == 2
    printed = capsys.readouterr()
    assert printed.out == "nowhere.yaml: error: cannot read file: No such file or directory\n"
    assert printed.err == "0 policies, 1 error, 0 warnings\n", "that no policy was found would be another mistake"


def test_missing_file_does_not_stop_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    bad = str(BAD / "min-above-max.yaml")
    assert main(["validate", str(POLICIES / "delivery-robot.yaml"), "nope.yaml", bad, "--output", "json"]) == 2
    document = json.loads(capsys.readouterr().out)
    assert [problem["file"] for problem in document["problems"]] == ["nope.yaml", bad]
    assert (document["valid"], len(document["policies"])) == (False, 1)


def test_malformed_object_reports_only_its_top_level_fields(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    odd = tmp_path / "odd.yaml"
    odd.write_text("apiVersion: contextpolicy.dev/v1alpha1\nkind: ContextPolicy\nmetadata: 5\nspec: 7\n")
    assert main(["validate", str(odd), "-o", "json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert [problem["field"] for problem in document["problems"]] == ["metadata", "spec"]
    assert (document["found"], document["policies"]) == (1, [])


@pytest.mark.parametrize("name", ["/dev/zero", "-"])
def test_endless_file_is_refused(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with Path("/dev/zero").open(encoding="utf-8") as endless:
        monkeypatch.setattr("sys.stdin", endless)
        assert main(["validate", name]) == 1
    assert "error: too long: expected at most 1048576 characters" in capsys.readouterr().out


def test_a_binary_file(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_bytes(b"\xff\xfe\xfa")
    assert main(["validate", str(tmp_path / "x.yaml")]) == 2
