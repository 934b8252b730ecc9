from dataclasses import replace

import pytest

from tests.node import base, build, layout
from tests.node.build import NODE


def test_both_version_packages_are_stamped():
    ldflags = build.kubernetes_ldflags("v1.36.3")
    for place in ("k8s.io/component-base/version", "k8s.io/client-go/pkg/version"):
        assert f"-X {place}.gitVersion=v1.36.3" in ldflags
        assert f"-X {place}.gitMajor=1" in ldflags
        assert f"-X {place}.gitMinor=36" in ldflags


def test_go_mod_and_the_stamped_version_agree():
    text = (layout.SOURCES / "program" / "go.mod").read_text()
    assert f"k8s.io/kubernetes {layout.KUBERNETES_VERSION}\n" in text
    staging = layout.KUBERNETES_VERSION.replace("v1.", "v0.")
    replaced = [line.split("=>")[1] for line in text.splitlines() if "=>" in line]
    assert replaced
    assert all(line.endswith(staging) for line in replaced)


def test_go_names_the_binary_as_the_node_starts_it():
    """After the last element of the module's path."""
    text = (layout.SOURCES / "program" / "go.mod").read_text()
    assert text.splitlines()[0].rpartition("/")[2] == NODE.name


@pytest.mark.parametrize(
    "changed",
    [replace(NODE, ldflags="-s"), replace(NODE, tags="x"), replace(NODE, cgo=True), replace(NODE, source="")],
)
def test_key_changes_with_everything_that_changes_the_binary(changed):
    assert build.program_key(changed) != build.program_key(NODE)


def test_fetched_programs_are_pinned():
    fetched = [program for program in (*build.PROGRAMS, *build.AUTOSCALER) if not program.source]
    assert fetched
    assert all("@v" in package for program in fetched for package in program.packages)


def test_base_image_takes_the_hosts_mirror_and_settings(tmp_path):
    command = base.command(tmp_path / "base.tar", ["python3"], ['Acquire::http::Proxy "p";'], ["mirror.sources"])
    assert '--aptopt=Acquire::http::Proxy "p";' in command
    assert command[-3:] == [base.SUITE, str(tmp_path / "base.tar"), "mirror.sources"]
