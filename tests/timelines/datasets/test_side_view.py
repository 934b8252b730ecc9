from __future__ import annotations

import cv2
import numpy as np

from timelines.datasets.readers import read
from timelines.datasets.side_view import HEIGHT, WIDTH, Plate, SideView, write


def pictures(folder, view):
    folder.mkdir(parents=True)
    write(folder, view, lambda _: None)
    return list(read(folder.parent.parent, "signs/x"))


def seen(jpeg):
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    return picture


def test_a_plate_is_in_the_pictures_of_its_time_only(tmp_path):
    found = pictures(tmp_path / "signs/x", SideView(3, (Plate(1, 2, "204"),)))
    assert [at for at, _ in found] == [0, 0.5, 1, 1.5, 2, 2.5]
    shown = [seen(jpeg) for _, jpeg in found]
    assert {picture.shape for picture in shown} == {(HEIGHT, WIDTH)}
    assert [bool((picture > 225).mean() > 0.02) for picture in shown] == [False, False, True, True, False, False]


def test_a_faster_camera_takes_more_pictures(tmp_path):
    found = pictures(tmp_path / "signs/x", SideView(1, (), rate=4))
    assert [at for at, _ in found] == [0, 0.25, 0.5, 0.75]


def test_the_same_view_gives_the_same_pictures_and_its_truth(tmp_path):
    view = SideView(1, (Plate(0, 1, "7B"),))
    assert pictures(tmp_path / "a/signs/x", view) == pictures(tmp_path / "b/signs/x", view)
    assert (tmp_path / "a/signs/x/truth.csv").read_text(encoding="utf-8") == "#from [s],to [s],text\n0,1,7B\n"
