from __future__ import annotations

import pytest

from modules.speech import synthesis
from timelines.datasets import speech
from timelines.datasets.__main__ import main
from timelines.datasets.euroc import Sequence
from timelines.datasets.motion import Motion
from timelines.datasets.recordings import RECORDINGS, fingerprint, make
from timelines.datasets.speech import Script

TINY = Sequence(Motion(duration=0.1, moving=((0, 0.1),)))


def test_a_recording_is_made_once(tmp_path):
    shares: list[float] = []
    assert make(tmp_path, "tiny", TINY, shares.append)
    assert shares == [0.5, 1.0]
    assert not make(tmp_path, "tiny", TINY, shares.append)
    assert [path.name for path in tmp_path.iterdir()] == ["tiny"]


def test_an_outdated_recording_is_replaced(tmp_path):
    (tmp_path / "tiny").mkdir()
    (tmp_path / "tiny/stamp").write_text("old", encoding="utf-8")
    assert make(tmp_path, "tiny", TINY, lambda _: None)
    assert (tmp_path / "tiny/mav0/cam0").is_dir()


def test_each_recording_has_its_own_fingerprint():
    prints = {fingerprint(recording) for recording in RECORDINGS.values()}
    assert len(prints) == len(RECORDINGS)
    assert fingerprint(Script(1, ())) == fingerprint(Script(1, ()))


@pytest.mark.parametrize("code", [speech, synthesis])
def test_speech_is_outdated_when_the_code_that_makes_it_changed(code, tmp_path, monkeypatch):
    before = fingerprint(Script(1, ()))
    (tmp_path / "changed.py").touch()
    monkeypatch.setattr(code, "__file__", str(tmp_path / "changed.py"))
    assert fingerprint(Script(1, ())) != before


def test_an_unknown_name_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["nonsense"])
    assert "expected one of euroc" in capsys.readouterr().err
