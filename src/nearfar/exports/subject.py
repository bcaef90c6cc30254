"""A localization to export, the names of its images, and its matches as keypoint pairs."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import IndexPairs, Mask
from nearfar.errors import ExportError
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.intrinsics import Intrinsics
from nearfar.imaging.decoding import read_orientation
from nearfar.imaging.image import Image, ImagePair
from nearfar.imaging.orientation import UPRIGHT
from nearfar.localization import Localization, PointMatches, read_again, read_images
from nearfar.storage.locations import is_text

KeypointArray = NDArray[np.float32]
"""(N, 2), x and y in pixels, each point once; (0, 0) is the centre of the top left pixel."""


@dataclass(frozen=True, eq=False)
class IndexedMatches:
    """One-to-one matches.

    Attributes:
        near: keypoints of the near image.
        far: keypoints of the far image.
        pairs: (M, 2), index into the near keypoints, index into the far keypoints.
        inliers: (M,) which pairs agree with the model.
    """

    near: KeypointArray
    far: KeypointArray
    pairs: IndexPairs
    inliers: Mask


def distinct_points(points: NDArray[np.floating]) -> KeypointArray:
    """Return each finite one of (N, 2) points once, in single precision, sorted."""
    single = _single(points)
    return np.unique(single[np.isfinite(single).all(axis=1)], axis=0)


def indexed(points: PointMatches) -> IndexedMatches:
    """Return the matches of one pair of images as pairs of keypoints of their own."""
    return indexed_in(points, distinct_points(points.near), distinct_points(points.far))


def indexed_in(points: PointMatches, near: KeypointArray, far: KeypointArray) -> IndexedMatches:
    """Return matches as pairs of given keypoints, as tools for structure from motion read them.

    A keypoint is in one match at most: in an inlier before others, else in the first.

    Args:
        points: the matches.
        near: keypoints of the near image, among which are all of the matches.
        far: keypoints of the far image, among which are all of the matches.
    """
    finite = np.isfinite(np.hstack([points.near, points.far])).all(axis=1)
    inliers = points.inliers[finite]
    every = np.column_stack(
        [_positions(points.near[finite], near), _positions(points.far[finite], far)]
    )
    inliers_first = np.argsort(~inliers, kind="stable")
    kept = inliers_first[_one_to_one(every[inliers_first])]
    return IndexedMatches(near, far, every[kept], inliers[kept])


def _single(points: NDArray[np.floating]) -> KeypointArray:
    return np.asarray(points, np.float32).reshape(-1, 2) + np.float32(0)  # -0 becomes 0.


def _positions(points: NDArray[np.floating], keypoints: KeypointArray) -> NDArray[np.intp]:
    row_of = {xy.tobytes(): row for row, xy in enumerate(keypoints)}
    return np.array([row_of[xy.tobytes()] for xy in _single(points)], np.intp)


def _one_to_one(pairs: IndexPairs) -> list[int]:
    """Return the rows of pairs whose keypoints are in no row kept before."""
    near_used: set[int] = set()
    far_used: set[int] = set()
    kept = []
    for row, (near, far) in enumerate(pairs.tolist()):
        if near not in near_used and far not in far_used:
            near_used.add(near)
            far_used.add(far)
            kept.append(row)
    return kept


@dataclass(frozen=True)
class ImageNames:
    """Names of both images, relative to the folder of images that a tool is given."""

    far: str
    near: str


@dataclass(frozen=True, eq=False)
class Subject:
    """A localization to export.

    Attributes:
        localization: the localization to write.
        intrinsics: cameras, for a localization that does not know them; None where unknown.
        far: name of the far image; None to take it from its path.
        near: name of the near image; None to take it from its path.
        images: both images, for formats that draw them; None to read them from their paths.
        dem: raster of heights, for formats that hold heights; None where they are not known.
    """

    localization: Localization
    intrinsics: Intrinsics | None = None
    far: str | None = None
    near: str | None = None
    images: ImagePair | None = None
    dem: Path | None = None

    @property
    def cameras(self) -> Intrinsics | None:
        """The cameras that it was localized with, or else those that are given; None if unknown."""
        return self.localization.intrinsics or self.intrinsics

    @property
    def pictures(self) -> ImagePair:
        """Both images with their pixels.

        Raises:
            ImageError: an image has no path, or is not there any more.
        """
        return self.images or read_images(self.localization)

    @property
    def full_near(self) -> Image:
        """The near image in its original size; of `images` as large as it is there.

        Raises:
            ImageError: it has no path, or is not there any more.
        """
        if self.images is not None:
            return self.images.near
        return read_again(self.localization.near, full=True)

    @property
    def names(self) -> ImageNames:
        """Names for tools that open the image files themselves and ignore their EXIF rotation.

        Raises:
            ExportError: an image has no path and no name, both have the same, a name is not UTF-8,
                or an image is displayed otherwise than it is stored.
            ImageError: the file of an image cannot be read.
        """
        paths = [self.localization.far.path, self.localization.near.path]
        for path in paths:
            if path is not None:
                check_stored_upright(path)
        if self.far is not None and self.near is not None:
            names = ImageNames(self.far, self.near)
        else:
            far, near = _relative(paths)
            names = ImageNames(self.far or far, self.near or near)
        for name in (names.far, names.near):
            if not is_text(name):
                raise ExportError(
                    f"COLMAP and hloc cannot hold {name!r}, a name that is not UTF-8: rename the "
                    f"file, or give far= and near= to nearfar.export"
                )
        if names.far == names.near:
            raise ExportError(
                f"both images are called {names.far}: give them different names (far=, near=)"
            )
        return names

    @property
    def pose(self) -> RelativePose:
        """The relative pose.

        Raises:
            ExportError: the localization has none.
        """
        found = self.localization
        if isinstance(found.far_from_near, RelativePose):
            return found.far_from_near
        why = f"is a {found.model}" if found.localized else f"failed ({found.reason})"
        raise ExportError(
            f"the localization {why}: a file of poses needs one with intrinsics (--intrinsics FILE)"
        )


def _relative(paths: list[Path | None]) -> list[str]:
    """Return the paths relative to the deepest folder that holds both files."""
    known = [Path(os.path.abspath(path)) for path in paths if path is not None]  # noqa: PTH100
    if len(known) < len(paths):
        raise ExportError(
            "an image that was given as an array has no name: say what its file is called "
            "(far=, near=)"
        )
    folder = os.path.commonpath([path.parent for path in known])
    return [path.relative_to(folder).as_posix() for path in known]


def check_stored_upright(path: Path) -> None:
    """Refuse an image that tools show otherwise than it is displayed here.

    Raises:
        ExportError: its EXIF orientation turns it.
        ImageError: its file cannot be read.
    """
    if read_orientation(path) != UPRIGHT:
        raise ExportError(
            f"{path} is displayed turned, by its EXIF orientation, which other tools do "
            f"not see: save it upright and localize again"
        )
