"""Frames of videos and of sequences of images."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from nearfar.errors import ImageError, SettingsError
from nearfar.imaging.video import frame_at, read_frames, read_sequence
from tests.imaging.made_video import COUNT, RATE, frame, write_video


def test_all_frames_come_with_their_times(tmp_path: Path) -> None:
    found = list(read_frames(write_video(tmp_path / "walk.avi")))
    assert [each.index for each in found] == list(range(COUNT))
    np.testing.assert_allclose([each.seconds for each in found], np.arange(COUNT) / RATE, atol=1e-3)
    for each in found:
        assert np.abs(each.pixels.astype(int) - frame(each.index)).mean() < 6


@pytest.mark.parametrize(("fps", "taken"), [(5, [0, 2, 4, 6, 8, 10]), (4, [0, 3, 5, 8, 10])])
def test_some_frames_a_second(tmp_path: Path, fps: float, taken: list[int]) -> None:
    found = list(read_frames(write_video(tmp_path / "walk.avi"), fps=fps))
    assert [each.index for each in found] == taken
    assert found[1].name == f"{taken[1] / RATE:010.3f}"
    files = []
    for index in range(COUNT):
        files.append(tmp_path / f"{index:03}.png")
        cv2.imwrite(str(files[-1]), frame(index)[..., ::-1])
    sequence = list(read_sequence(files, rate=RATE, fps=fps))
    assert [each.index for each in sequence] == taken
    np.testing.assert_array_equal(sequence[2].pixels, frame(taken[2]))


def test_a_frame_is_found_by_the_time_in_its_name(tmp_path: Path) -> None:
    video = write_video(tmp_path / "walk.avi")
    for each in list(read_frames(video))[::5]:
        found = frame_at(video, float(each.name))
        assert np.abs(found.astype(int) - each.pixels).mean() < 1
    np.testing.assert_array_equal(frame_at(video, 99), frame_at(video, (COUNT - 1) / RATE))


def test_what_is_no_video_is_refused(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "walk.avi").read_bytes()
    (tmp_path / "text.mp4").write_text("not a video")
    (tmp_path / "cut.avi").write_bytes(whole[:400])
    for name in ("text.mp4", "cut.avi", "missing.mp4"):
        with pytest.raises(ImageError, match=name):
            list(read_frames(tmp_path / name))
    with pytest.raises(ImageError, match="max-pixels"):
        list(read_frames(tmp_path / "walk.avi", max_pixels=100))
    for fps in (0, -1, float("nan")):
        with pytest.raises(SettingsError, match="--fps"):
            list(read_frames(tmp_path / "walk.avi", fps=fps))
