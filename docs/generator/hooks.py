"""How MkDocs reads this repository: every Markdown document is a page, and what documents link to is copied.

So a link works alike in the repository and on the site, and the site needs nothing from outside.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from mkdocs.structure.files import File, Files

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
HOME = "README.md"
_LINK = re.compile(r"\[([^][]*)\]\(([^)\s]+)\)")
_PICTURE = re.compile(r'\b(src|srcset)="([^"]+)"')


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Replace the files of docs/ by all documents, at their paths in the repository."""
    for file in [file for file in files if file.src_dir == config.docs_dir]:
        files.remove(file)
    documents = _documents()
    for name in sorted({*documents, *_linked(documents)}):
        files.append(File(name, str(ROOT), config.site_dir, use_directory_urls=False, dest_uri=destination(name)))
    return files


def on_page_markdown(markdown: str, *, page: Page, files: Files, **_: object) -> str:
    """Let links to a folder lead to its README, or be plain text where it has none, and pictures to where they are."""

    def rewritten(link: re.Match[str]) -> str:
        target = _target(page.file.src_uri, link[2])
        if target is None or not (ROOT / target).is_dir():
            return link[0]
        has_readme = files.get_file_from_path(f"{target}/{HOME}") is not None
        return f"[{link[1]}]({link[2].rstrip('/')}/{HOME})" if has_readme else link[1]

    def moved(picture: re.Match[str]) -> str:
        target = _target(page.file.src_uri, picture[2])
        if target is None or not (ROOT / target).is_file():
            return picture[0]
        here = PurePosixPath(destination(page.file.src_uri)).parent
        return f'{picture[1]}="{os.path.relpath(destination(target), here)}"'

    return _PICTURE.sub(moved, _LINK.sub(rewritten, markdown))


def destination(name: str) -> str:
    """Where a file of the repository is on the site: its README is the home page, and docs/ is left out."""
    path = PurePosixPath(name.removeprefix("docs/"))
    if path.suffix != ".md":
        return str(path)
    return str(path.with_name("index.html" if path.name == HOME else f"{path.stem}.html"))


def _documents() -> list[str]:
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True, timeout=60).stdout.split()
    return [name for name in names if (ROOT / name).exists()]


def _linked(documents: Iterable[str]) -> Iterator[str]:
    """The files that documents link to or show, and that are no documents themselves."""
    for name in documents:
        text = (ROOT / name).read_text(encoding="utf-8")
        for _, link in (*_LINK.findall(text), *_PICTURE.findall(text)):
            target = _target(name, link)
            if target is not None and not target.endswith(".md") and (ROOT / target).is_file():
                yield target


def _target(document: str, link: str) -> str | None:
    """What a relative link of a document leads to, from the repository's root; None for all other links."""
    path = link.partition("#")[0]
    if not path or re.match(r"\w+:|/", path):
        return None
    return os.path.normpath(f"{PurePosixPath(document).parent}/{path}")
