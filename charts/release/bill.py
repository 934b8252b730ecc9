"""What is in the images, package by package: a bill of materials (SPDX) for each architecture, by syft."""

from __future__ import annotations

import json
import os
import tarfile
from typing import TYPE_CHECKING, Any

from tests.node import build
from tests.node.layout import CACHE
from tests.node.shell import run_long

if TYPE_CHECKING:
    from pathlib import Path


def write(folder: Path, image: Path) -> list[Path]:
    """Write a bill for each architecture in an image's archive."""
    syft = str(build.build(build.SYFT) / "syft")
    return [_write(syft, folder, image, one) for one in architectures(image)]


def architectures(image: Path) -> list[str]:
    """Read the architectures of an OCI archive from its index."""
    with tarfile.open(image) as archive:
        (entry,) = _json(archive, "index.json")["manifests"]
        images = _json(archive, f"blobs/{entry['digest'].replace(':', '/')}")["manifests"]
    return [one["platform"]["architecture"] for one in images]


def _json(archive: tarfile.TarFile, name: str) -> dict[str, Any]:
    file = archive.extractfile(name)
    content: dict[str, Any] = json.load(file) if file else {}
    return content


def _write(syft: str, folder: Path, image: Path, architecture: str) -> Path:
    target = folder / f"{image.stem.removesuffix('-image')}-linux-{architecture}.spdx.json"
    argv = [
        syft,
        "scan",
        f"oci-archive:{image}",
        "--platform",
        f"linux/{architecture}",
        "--output",
        f"spdx-json={target}",
    ]
    env = {**os.environ, "SYFT_CHECK_FOR_APP_UPDATE": "false"}
    log = CACHE / "logs" / "release-bill.log"
    run_long(f"listing what is in the image for {architecture}", argv, output=log, timeout=600, env=env)
    return target
