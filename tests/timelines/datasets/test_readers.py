from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import pytest

from contextpolicy.streams.timeline import parse
from robotkit.euroc import DatasetError
from robotkit.stereo import decode
from tests.modules.sounds import write
from timelines.datasets.readers import read

START = 1403636579763555584


@pytest.fixture
def recorded(tmp_path):
    """Two frames as they come from the archive: CRLF, and the second right picture is missing."""
    mav0 = tmp_path / "real/mav0"
    for camera in ("cam0", "cam1"):
        (mav0 / camera / "data").mkdir(parents=True)
        rows = [f"{START + step},{START + step}.png\r\n" for step in (0, 50_000_000)]
        (mav0 / camera / "data.csv").write_bytes("".join(["#timestamp [ns],filename\r\n", *rows, "\r\n"]).encode())
        (mav0 / camera / "data" / f"{START}.png").write_bytes(camera.encode())
    (mav0 / "cam0/data" / f"{START + 50_000_000}.png").write_bytes(b"alone")
    for sensor, lines in (
        ("imu0", [f"{START},1,2,3,4,5,6\n"]),
        ("state_groundtruth_estimate0", [f"{START + t},{t / 1e8},0,0,1,0,0,0,3,4,0\n" for t in (0, 100_000_000)]),
    ):
        (mav0 / sensor).mkdir()
        (mav0 / sensor / "data.csv").write_text("".join(lines))
    return tmp_path


def test_a_frame_without_its_partner_is_left_out(recorded):
    ((at, payload),) = read(recorded, "real/stereo")
    assert isinstance(payload, bytes)
    frame = decode(payload)
    assert (at, frame.stamp, frame.left, frame.right) == (0.0, START, b"cam0", b"cam1")


def test_imu_samples_have_gyro_accel_and_speed(recorded):
    assert list(read(recorded, "real/imu")) == [
        (0.0, {"gyro": [1.0, 2.0, 3.0], "accel": [4.0, 5.0, 6.0], "speed": 5.0})
    ]


@pytest.mark.parametrize("name", ["MH_01_easy", "V1_02_medium"])
def test_original_euroc_names_are_read(recorded, name):
    (recorded / "real").rename(recorded / name)
    timeline = {"key": "robot/imu", "encoding": "json", "from": 0, "to": 1, "dataset": f"{name}/imu"}
    (entry,) = parse({"name": "real", "duration": 1, "inputs": [timeline]}).entries
    assert entry.dataset is not None
    assert len(list(read(recorded, entry.dataset))) == 1


def test_without_ground_truth_there_is_no_speed(recorded):
    shutil.rmtree(recorded / "real/mav0/state_groundtruth_estimate0")
    assert list(read(recorded, "real/imu")) == [(0.0, {"gyro": [1.0, 2.0, 3.0], "accel": [4.0, 5.0, 6.0]})]


def test_true_speed_is_unknown_outside_the_ground_truth(recorded):
    truth = recorded / "real/mav0/state_groundtruth_estimate0/data.csv"
    truth.write_text("".join(f"{START + t},0,0,0,1,0,0,0,{speed},0,0\n" for t, speed in ((0, 1), (100_000_000, 3))))
    imu = recorded / "real/mav0/imu0/data.csv"
    imu.write_text("".join(f"{START + t},1,2,3,4,5,6\n" for t in (-5, 0, 25_000_000, 100_000_001)))
    samples: list[Any] = [sample for _, sample in read(recorded, "real/imu")]
    assert [sample.get("speed") for sample in samples] == [None, 1.0, 1.5, None]


def test_audio_chunks_are_stamped_at_their_end(tmp_path):
    write(tmp_path / "speech/x/audio.wav", np.zeros(4000))
    chunks = [(round(at, 3), len(payload)) for at, payload in read(tmp_path, "speech/x")]
    assert chunks == [(0.1, 3200), (0.2, 3200)]


@pytest.mark.parametrize("name", ["euroc/stereo", "speech/x", "real/stereo", "nonsense"])
def test_a_missing_data_set_says_how_to_generate_it(tmp_path, name):
    with pytest.raises(DatasetError, match=r"python -m timelines\.datasets"):
        read(tmp_path, name)
