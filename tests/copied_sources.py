"""The sources in a folder of their own, to try a change there: how many files it takes, and what the tests say."""

from __future__ import annotations

import filecmp
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = (
    *("operator/contextpolicy", "charts/contextpolicy/files", "crds", "config/policies", "docs/reference"),
    *("tests/crds", "tests/policy", "tests/e2e/bad_policies"),
)
DEFINITION = "crds/contextpolicies.contextpolicy.dev.yaml"
POLICY = """\
apiVersion: contextpolicy.dev/v1alpha1
kind: ContextPolicy
metadata: {name: robot, namespace: lab}
spec:
  streams:
  - {name: %(stream)s, key: robot/imu, example: {speed: 0.5, frame: imu_link}}
  tasks:
  - {name: slam, selector: {matchLabels: {app: slam}}%(task)s}
  contexts:
  - {name: moving, when: "%(when)s"}
"""


class Copy:
    """The sources in a folder of their own."""

    def __init__(self, folder):
        self.folder = folder
        for source in SOURCES:
            shutil.copytree(ROOT / source, folder / source, ignore=shutil.ignore_patterns("__pycache__"))
        for source in ("pyproject.toml", "tests/conftest.py"):
            shutil.copy(ROOT / source, folder / source)

    def edit(self, patch):
        for name, (old, new) in patch.items():
            text = (self.folder / name).read_text(encoding="utf-8")
            assert text.count(old) == 1, f"{name} has another place for this"
            (self.folder / name).write_text(text.replace(old, new), encoding="utf-8")

    def edited(self):
        """The files that are new, or differ from the originals."""
        files = [path.relative_to(self.folder) for path in self.folder.rglob("*") if path.suffix in {".py", ".yaml"}]
        same, *_ = filecmp.cmpfiles(self.folder, ROOT, map(str, files), shallow=False)
        return {str(path) for path in files} - {*same}

    def python(self, *arguments):
        search = (self.folder / "operator", self.folder, ROOT, ROOT / "modules/robotkit")
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, search))}
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    def make_crds(self):
        self.python("-m", "crds").check_returncode()

    def failures(self, *tests):
        """What pytest says of tests that fail in the copy, empty when they pass."""
        done = self.python("-m", "pytest", "-q", "-p", "no:cacheprovider", *tests)
        assert done.returncode in {0, 1}, done.stdout + done.stderr
        return done.stdout if done.returncode else ""

    def validate(self, *, stream="imu", task="", when="true"):
        """What `validate` says of a policy, empty when it is right."""
        path = self.folder / "policy.yaml"
        path.write_text(POLICY % {"stream": stream, "task": task, "when": when}, encoding="utf-8")
        done = self.python("-m", "contextpolicy", "validate", str(path))
        path.unlink()
        return done.stdout + done.stderr if done.returncode else ""
