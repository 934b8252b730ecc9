"""What the audit of installed packages says, and when it fails."""

import json

import pytest

from tests.audit import judge

FOUND = {"name": "one", "version": "1.0", "vulns": [{"id": "PYSEC-1", "fix_versions": ["1.1"]}]}


@pytest.mark.parametrize(
    ("packages", "known", "code", "said"),
    [
        ([FOUND], {}, 1, "one 1.0: PYSEC-1, fixed in 1.1: NOT KNOWN"),
        ([FOUND], {"PYSEC-1": "not called"}, 0, "one 1.0: PYSEC-1, fixed in 1.1: not called"),
        ([], {"PYSEC-1": "not called"}, 1, "no longer found"),
        ([{"name": "one", "skip_reason": "no network"}, FOUND], {}, 2, "nothing is known of them: one"),
        ([], {}, 0, "0 advisories"),
    ],
)
def test_unexplained_findings_and_stale_reasons_fail(packages, known, code, said, capsys):
    assert judge(json.dumps({"dependencies": packages}), known) == code
    assert said in capsys.readouterr().out
