import tomllib
from pathlib import Path

import pytest

from contextpolicy.cli import main

PROJECT = Path(__file__).parents[2] / "pyproject.toml"


@pytest.mark.parametrize("before", [[], ["--help"]])
def test_version_option_prints_the_version(before, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version", *before])
    assert ended.value.code == 0
    version = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["version"]
    assert capsys.readouterr().out.split()[-1] == version
