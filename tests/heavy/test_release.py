"""A release that `make heavy` built, a copy of it built again, and a real registry."""

from __future__ import annotations

import contextlib
import io
import json
import re
import subprocess
import tarfile
import time
import urllib.request
from collections import Counter

import pytest

from charts.release import images
from tests.node import build
from tests.node.layout import REPOSITORY
from tests.ports import free_port

RELEASE, AGAIN = REPOSITORY / "build" / "release", REPOSITORY / "build" / "release-again"
LOCK = (REPOSITORY / "operator" / "requirements.txt").read_text(encoding="utf-8")
INDEX = "application/vnd.oci.image.index.v1+json"
UNCHECKED_HASH = (1).to_bytes(4, "little")


def run(*argv):
    done = subprocess.run(argv, cwd=RELEASE, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def one(pattern, folder=RELEASE):
    found = list(folder.glob(pattern))
    assert len(found) == 1, f"{folder}/{pattern}: {found or 'run `make heavy`, which builds the release'}"
    return found[0]


def opened(tar, member):
    file = tar.extractfile(member)
    assert file is not None, f"{member.name} is no file"
    return file


def described(archive):
    """The index in an image's archive: the description of each architecture's image, and the contents of all blobs."""
    with tarfile.open(archive) as tar:
        content = {member.name: opened(tar, member).read() for member in tar if member.isfile()}
    (entry,) = json.loads(content["index.json"])["manifests"]
    index = json.loads(blob(content, entry))
    return {each["platform"]["architecture"]: each for each in index["manifests"]}, content, entry


def blob(content, entry):
    return content["blobs/" + entry["digest"].replace(":", "/")]


def test_the_image_is_there_for_both_architectures_under_its_version():
    found, content, entry = described(one("*-image.tar"))
    assert set(found) == set(images.ARCHITECTURES)
    version = one("contextpolicy-*.tgz").name.removeprefix("contextpolicy-").removesuffix(".tgz")
    assert entry["annotations"]["io.containerd.image.name"] == f"docker.io/library/contextpolicy:{version}"
    for architecture, each in found.items():
        config = json.loads(blob(content, json.loads(blob(content, each))["config"]))
        assert config["architecture"] == architecture
        assert config["config"]["Labels"]["org.opencontainers.image.version"] == version
        assert re.fullmatch("[0-9a-f]{40}", config["config"]["Labels"]["org.opencontainers.image.revision"])


def test_bytecode_does_not_depend_on_file_times():
    """Bytecode that names the time of its source is out of date in an image whose files all have the commit's."""
    found, content, _ = described(one("*-image.tar"))
    for each in found.values():
        layers = [blob(content, layer) for layer in json.loads(blob(content, each))["layers"]]
        kinds = Counter(kind for layer in layers for kind in bytecode(layer))
        assert kinds.keys() == {UNCHECKED_HASH}
        assert kinds[UNCHECKED_HASH] > 1000


def bytecode(layer):
    """What each library's bytecode says about its source (PEP 552); Debian has some of tools that nobody starts."""
    with tarfile.open(fileobj=io.BytesIO(layer)) as tar:
        for member in tar:
            if member.name.endswith(".pyc") and "/lib/python" in member.name:
                yield opened(tar, member).read(8)[4:]


def test_release_build_is_reproducible():
    first, second = described(one("*-image.tar"))[0], described(one("*-image.tar", AGAIN))[0]
    assert {name: first[name]["digest"] for name in second} == {name: each["digest"] for name, each in second.items()}
    assert one("contextpolicy-*.tgz").read_bytes() == one("contextpolicy-*.tgz", AGAIN).read_bytes()


def test_checksums_and_signature_hold():
    run("sha256sum", "--check", "--strict", "SHA256SUMS")
    run("openssl", "dgst", "-sha256", "-verify", "release.pub", "-signature", "SHA256SUMS.sig", "SHA256SUMS")


@pytest.mark.parametrize("architecture", images.ARCHITECTURES)
def test_sbom_lists_locked_and_debian_packages(architecture):
    bill = json.loads(one(f"*-linux-{architecture}.spdx.json").read_text())
    found = {(package["name"].lower().replace("_", "-"), package.get("versionInfo")) for package in bill["packages"]}
    locked = set(re.findall(r"^([a-z0-9-]+)==([^ ;]+) \\$", LOCK, flags=re.MULTILINE))
    assert locked - found == set()  # Debian has packages of the same name, such as tzdata
    assert {"contextpolicy", "libc6", "python3.11-minimal"} <= {name for name, _ in found}


@pytest.fixture(scope="module")
def registry(tmp_path_factory):
    """The address of an empty registry."""
    address = f"127.0.0.1:{free_port()}"
    folder = tmp_path_factory.mktemp("registry")
    (folder / "config.yaml").write_text(
        f"version: 0.1\nstorage: {{filesystem: {{rootdirectory: {folder}/data}}}}\nhttp: {{addr: '{address}'}}\n"
    )
    argv = [build.build(build.REGISTRY) / "registry", "serve", folder / "config.yaml"]
    with (folder / "log").open("w") as log, subprocess.Popen(argv, stdout=log, stderr=log) as process:
        try:
            deadline = time.monotonic() + 60
            while not answers(address):
                assert time.monotonic() < deadline, (folder / "log").read_text()
                time.sleep(0.1)
            yield address
        finally:
            process.terminate()


def answers(address):
    with contextlib.suppress(OSError), urllib.request.urlopen(f"http://{address}/v2/", timeout=5):
        return True
    return False


def test_image_is_pushed_to_a_registry_unchanged(registry):
    archive = one("*-image.tar")
    target = f"{registry}/robots/contextpolicy:1"
    run("skopeo", "copy", "--all", "--dest-tls-verify=false", f"oci-archive:{archive}", f"docker://{target}")
    url = f"http://{registry}/v2/robots/contextpolicy/manifests/1"
    with urllib.request.urlopen(urllib.request.Request(url, headers={"Accept": INDEX}), timeout=30) as answer:
        stored = {each["digest"] for each in json.load(answer)["manifests"]}
    assert stored == {each["digest"] for each in described(archive)[0].values()}


def test_the_chart_goes_into_a_registry_and_is_installed_from_there(registry, tmp_path):
    helm, chart = build.build(build.HELM) / "helm", one("contextpolicy-*.tgz")
    version = chart.stem.removeprefix("contextpolicy-")
    run(helm, "push", chart, f"oci://{registry}/charts", "--plain-http")
    where = (f"oci://{registry}/charts/contextpolicy", "--version", version, "--plain-http")
    run(helm, "pull", *where, "--destination", tmp_path)
    assert (tmp_path / chart.name).read_bytes() == chart.read_bytes()
    mirrored = f"image.repository={registry}/robots/contextpolicy"
    assert f"image: {registry}/robots/contextpolicy:{version}\n" in run(helm, "template", *where, "--set", mirrored)
