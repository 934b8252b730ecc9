"""The site is built without a warning, so every link and anchor leads somewhere, and it loads nothing from outside."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
LOADED = re.compile(
    r"""(?:<(?:script|img|iframe|source)\b[^>]*\bsrc|<link\b[^>]*\bhref)="?((?:https?:)?//[^"\s>]+)"""
    r"""|url\(["']?(https?:[^)"']+)"""
)


class Loader(yaml.SafeLoader):
    """Reads .mkdocs.yml without making its Python objects."""


Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    built = subprocess.run(
        [
            sys.executable,
            "-m",
            "mkdocs",
            "build",
            "--config-file",
            ".mkdocs.yml",
            "--strict",
            "--quiet",
            "--site-dir",
            str(folder),
        ],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def pages(entry):
    """The documents that the navigation names."""
    if isinstance(entry, str):
        yield entry
    for below in entry.values() if isinstance(entry, dict) else entry if isinstance(entry, list) else ():
        yield from pages(below)


def test_nothing_is_loaded_from_outside(site):
    texts = [path for suffix in ("*.html", "*.css") for path in site.rglob(suffix)]
    assert len(texts) > 60
    assert {path.name: LOADED.findall(text) for path in texts if LOADED.search(text := path.read_text("utf-8"))} == {}


def test_the_readme_is_the_home_page_and_links_to_pages(site):
    home = (site / "index.html").read_text("utf-8")
    assert "Try it in five minutes" in home
    assert 'href="how-to/install.html' in home


def test_pictures_are_on_the_site_where_their_pages_look_for_them(site):
    page = site / "how-to" / "watch.html"
    shown = re.findall(r'<(?:source|img)\b[^>]*\bsrc(?:set)?="([^"]+)"', page.read_text("utf-8"))
    assert [Path(one).name for one in shown] == ["live-page-dark.png", "live-page.png"]
    assert all((page.parent / one).is_file() for one in shown)


def test_linked_files_are_on_the_site(site):
    assert (site / "config" / "policies" / "ros2.yaml").read_bytes() == (
        ROOT / "config" / "policies" / "ros2.yaml"
    ).read_bytes()


def test_the_navigation_names_every_page_of_the_docs():
    text = (ROOT / ".mkdocs.yml").read_text("utf-8")
    nav = yaml.load(text, Loader=Loader)["nav"]  # noqa: S506 - the loader is derived from SafeLoader
    written = {str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md")}
    assert written - set(pages(nav)) == set()
