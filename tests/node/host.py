"""What the host needs to reach its package registries, handed into image builds and kept out of images."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from configparser import ConfigParser
from io import StringIO
from pathlib import Path

from tests.node.layout import CACHE

AUTHORITIES = ("PIP_CERT", "SSL_CERT_FILE", "REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE")
AUTHORITIES_IN_IMAGE = "/etc/ssl/certs/ca-certificates.crt"
PIP_CACHE_IN_IMAGE = "/var/cache/pip"
APT_PREFIXES = ("Acquire::http", "Acquire::https")


def volumes() -> list[str]:
    """Return what a build mounts: pip's settings and cache, apt's proxy, the certificate authorities."""
    folder = CACHE / "build"
    (folder / "pip").mkdir(parents=True, exist_ok=True)
    pip = pip_settings(output(sys.executable, "-m", "pip", "config", "list"))
    apt = apt_settings(output("apt-config", "dump"))
    (folder / "pip.conf").write_text(pip_configuration(pip))
    (folder / "apt.conf").write_text("\n".join(apt) + "\n")
    mounts = {PIP_CACHE_IN_IMAGE: folder / "pip", "/etc/pip.conf": folder / "pip.conf"}
    if apt:
        mounts["/etc/apt/apt.conf.d/99host"] = folder / "apt.conf"
    if authorities := _authorities():
        mounts[AUTHORITIES_IN_IMAGE] = authorities
    named = {str(path): path for path in named_paths([*pip.values(), *apt])}
    return [f"{source}:{target}" for target, source in {**named, **mounts}.items()]


def pip_settings(listing: str) -> dict[str, str]:
    """Read `pip config list`; what the environment says goes before what the files say."""
    lines = [line.partition("=") for line in listing.splitlines() if "=" in line]
    ordered = sorted(lines, key=lambda line: line[0].startswith(":env:"))
    return {name.rpartition(".")[2]: str(ast.literal_eval(value)) for name, _, value in ordered}


def pip_configuration(settings: dict[str, str]) -> str:
    parser = ConfigParser(interpolation=None)
    parser["global"] = {**settings, "cache-dir": PIP_CACHE_IN_IMAGE}
    text = StringIO()
    parser.write(text)
    return text.getvalue()


def apt_settings(dump: str) -> list[str]:
    return [line for line in dump.splitlines() if line.startswith(APT_PREFIXES) and not line.endswith(' "";')]


def named_paths(values: list[str]) -> set[Path]:
    """Find the files and folders of the host that settings name: they must exist inside the build too."""
    words = {word.strip('";') for value in values for word in value.split()}
    return {Path(word) for word in words if word.startswith("/") and Path(word).exists()}


def _authorities() -> Path | None:
    files = (Path(os.environ[name]) for name in AUTHORITIES if os.environ.get(name))
    return next((file for file in files if file.is_file()), None)


def output(*argv: str) -> str:
    """Return what a program prints; a host without the program has none of its settings."""
    try:
        return subprocess.run(argv, capture_output=True, text=True, timeout=60, check=False).stdout
    except FileNotFoundError:
        return ""
