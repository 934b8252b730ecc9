"""What a release's files are made of, without building an image."""

from __future__ import annotations

import argparse
import os
import subprocess

import pytest

from charts.release import airgap, archives, checksums, images, signature
from charts.release.source import Commit
from tests.node.errors import ClusterError

DIGEST = "sha256:" + "0" * 64


@pytest.fixture
def commit(tmp_path):
    (tmp_path / "tree").mkdir()
    (tmp_path / "tree" / "pyproject.toml").write_text('[project]\nversion = "1.2.3"\n')
    return Commit("abc", 1_700_000_000, tmp_path / "tree")


def packed(commit, folder):
    """An air-gapped archive of an image and a chart that are not real."""
    folder.mkdir()
    image, chart = folder / "contextpolicy-1.2.3-image.tar", folder / "contextpolicy-1.2.3.tgz"
    image.write_bytes(b"image")
    chart.write_bytes(b"chart")
    return airgap.pack(commit, folder, image, chart)


def test_archives_are_reproducible(tmp_path):
    made = []
    for age in (0, 1000):
        folder = tmp_path / f"folder-{age}"
        (folder / "sub").mkdir(parents=True)
        (folder / "sub" / "file").write_text("content")
        (folder / "run.sh").touch(mode=0o700 if age else 0o755)
        os.utime(folder / "sub" / "file", (age, age))
        made.append(archives.tar(folder, tmp_path / f"{age}.tar", epoch=7).read_bytes())
    assert made[0] == made[1]


def test_airgap_release_is_one_archive(commit, tmp_path):
    archive = packed(commit, tmp_path / "release")
    assert archive.name == "contextpolicy-1.2.3-airgap.tar"
    subprocess.run(["tar", "xf", archive], cwd=tmp_path, check=True, timeout=10)
    folder = tmp_path / "contextpolicy-1.2.3-airgap"
    names = ["SHA256SUMS", "contextpolicy-1.2.3-image.tar", "contextpolicy-1.2.3.tgz", "import-images.sh", "install.sh"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert os.access(folder / "install.sh", os.X_OK)
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=folder, check=True, timeout=10)


@pytest.fixture
def robot(commit, tmp_path):
    """Run the installer where helm and ctr only say what they were asked."""
    archive = packed(commit, tmp_path / "release")
    subprocess.run(["tar", "xf", archive], cwd=tmp_path, check=True, timeout=10)
    programs = tmp_path / "bin"
    programs.mkdir()
    for name in ("helm", "ctr"):
        (programs / name).write_text(f'#!/bin/sh\necho {name} "$@"\n')
        (programs / name).chmod(0o755)
    folder = tmp_path / "contextpolicy-1.2.3-airgap"
    env = {"PATH": f"{programs}:/usr/bin:/bin", "KUBECONFIG": "robot.yaml"}

    def install(*options):
        argv = [folder / "install.sh", *options]
        return subprocess.run(argv, capture_output=True, text=True, env=env, cwd=tmp_path, timeout=30, check=False)

    return folder, programs, install


def test_one_command_imports_and_installs(robot):
    _, _, install = robot
    imported, installed = install("--set", "agent.enabled=true").stdout.splitlines()
    assert imported == "ctr --namespace k8s.io images import contextpolicy-1.2.3-image.tar"
    assert installed.startswith("helm upgrade --install contextpolicy contextpolicy-1.2.3.tgz --namespace")
    assert installed.endswith("--set image.pullPolicy=Never --wait --set agent.enabled=true")


def test_a_damaged_archive_is_not_installed(robot):
    folder, _, install = robot
    (folder / "contextpolicy-1.2.3-image.tar").write_bytes(b"imagE")
    done = install()
    assert (done.returncode != 0, done.stdout) == (True, "contextpolicy-1.2.3-image.tar: FAILED\n")


def test_install_stops_first_if_helm_is_missing(robot):
    _, programs, install = robot
    (programs / "helm").unlink()
    done = install()
    assert (done.returncode, done.stdout) == (2, "")
    assert "helm is not on the PATH" in done.stderr


def signed(tmp_path):
    file = tmp_path / checksums.FILE
    file.write_text("0000  image.tar\n")
    signature.sign(file, tmp_path / "keys" / "release.key")
    return file


def verified(file):
    """As the README says."""
    argv = ["openssl", "dgst", "-sha256", "-verify", "release.pub", "-signature", "SHA256SUMS.sig", file.name]
    return subprocess.run(argv, cwd=file.parent, capture_output=True, check=False, timeout=30).returncode == 0


def test_openssl_verifies_the_signature_and_nothing_else(tmp_path):
    file = signed(tmp_path)
    assert verified(file)
    file.write_text("0001  image.tar\n")
    assert not verified(file)


def test_a_key_is_made_once_and_only_its_owner_may_read_it(tmp_path):
    signed(tmp_path)
    key = tmp_path / "keys" / "release.key"
    before = key.read_bytes()
    signed(tmp_path)
    assert key.read_bytes() == before
    assert key.stat().st_mode & 0o777 == 0o600


def test_an_invalid_key_is_reported(tmp_path):
    key = tmp_path / "key"
    key.write_text("secret")
    with pytest.raises(ClusterError, match=f"{key}: expected a private key in PEM"):
        signature.sign(tmp_path / checksums.FILE, key)


def test_a_base_image_is_pinned():
    assert images.pinned(f"python:3.11@{DIGEST}") == f"python:3.11@{DIGEST}"
    with pytest.raises(argparse.ArgumentTypeError, match="expected NAME@sha256"):
        images.pinned("python:3.11-slim")
