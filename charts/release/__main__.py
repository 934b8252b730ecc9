"""The command line: python -m charts.release builds everything that a version consists of into a folder."""

from __future__ import annotations

import argparse
import logging
import shutil
import sys
import tempfile
from pathlib import Path

from charts.release import airgap, bill, chart, checksums, images, signature, source
from tests.node.errors import ClusterError
from tests.node.layout import REPOSITORY

log = logging.getLogger(__name__)

KEY = Path.home() / ".config" / "contextpolicy" / "release.key"


def parser() -> argparse.ArgumentParser:
    """Return the command line's parser."""
    top = argparse.ArgumentParser(prog="python -m charts.release", description="Build a release of the last commit.")
    top.add_argument("--output", type=Path, default=REPOSITORY / "build" / "release", help="default: build/release")
    top.add_argument(
        "--architecture",
        action="append",
        choices=images.ARCHITECTURES,
        help="repeatable (default: all); one other than this machine's is emulated",
    )
    top.add_argument(
        "--base-image",
        type=images.pinned,
        metavar="NAME@sha256:...",
        help="base of the image, with Python 3.11 or later and venv (default: one made of Debian's packages)",
    )
    top.add_argument("--key", type=Path, default=KEY, help=f"signing key, created if missing (default: {KEY})")
    top.add_argument(
        "--no-bill", action="store_true", help="leave out the bills of materials, as building syft takes long"
    )
    return top


def main() -> int:
    """Build into a folder beside, which then takes the place of the last one."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    arguments = parser().parse_args()
    output: Path = arguments.output.resolve()
    output.parent.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(dir=output.parent, prefix=".release-") as draft:
            Path(draft).chmod(0o755)
            release(Path(draft), arguments)
            shutil.rmtree(output, ignore_errors=True)
            shutil.copytree(draft, output)
    except ClusterError as error:
        log.error("error: %s", error)  # noqa: TRY400, the message is the explanation
        return 1
    for line in (output / checksums.FILE).read_text().splitlines():
        log.info("%s", line)
    return 0


def release(folder: Path, arguments: argparse.Namespace) -> None:
    """Make all files of the release in an empty folder."""
    with source.exported() as commit:
        (folder / "NOTES.md").write_text(commit.notes())
        image = images.build(commit, folder, arguments.architecture or images.ARCHITECTURES, arguments.base_image)
        package = chart.package(commit, folder)
        airgap.pack(commit, folder, image, package)
    if not arguments.no_bill:
        bill.write(folder, image)
    signature.sign(checksums.write(folder), arguments.key)


if __name__ == "__main__":
    sys.exit(main())
