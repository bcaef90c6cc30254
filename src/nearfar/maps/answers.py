"""Results of locating a query in a map."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from nearfar.arrays import Coordinates, Matrix3, RGBPixels
from nearfar.geometry.epipolar import RelativePose
from nearfar.imaging.image import ImagePair
from nearfar.localization import Localization, PointMatches
from nearfar.maps.world.photo_position import PhotoPosition
from nearfar.maps.world.places import DECIMALS, GeoPlace, QueryPose, ring
from nearfar.maps.world.prior import Prior
from nearfar.models import Alternative, FailureKind
from nearfar.render import save
from nearfar.render.alignment import footprint_page
from nearfar.render.matches import point_matches
from nearfar.render.page import Caption, Entry
from nearfar.storage.locations import Location, as_text, replaced


@dataclass(frozen=True, eq=False)
class MapAnswer:
    """The query located in one image of a map.

    Attributes:
        image: name of the map image.
        far_from_near: homography from pixels of the query, undistorted where its camera has
            distortion, to pixels of the original map image; a relative pose where the intrinsics of
            both cameras are known.
        footprint: (4, 2) outline of the query in the map image (top left, top right, bottom right,
            bottom left of the query), or (64, 2) where its camera has distortion; None for a pose,
            and where the horizon crosses the query.
        scale_change: median, over all pairs of inliers, of their distance in the query divided by
            their distance in the map image.
        confidence: calibrated probability that the answer is correct.
        votes: sum of the weights of the query's landmarks that vote for it.
        points: matched points, in pixels of the original map image (far) and of the query (near).
        world: position of the query on the Earth, by the georeference of the map image, or by the
            GPS positions of photographs; None where it is not known.
        alternatives: other places of the map image that fit nearly as well, best first, in pixels
            of the query and of the original map image; the confidence is shared among all.
        localization: the query, without distortion, localized in a tile of the map image, in
            pixels of that tile.
        images: that tile (far) and the query without distortion (near).
        expected_error: how far the answer is expected to be off in the mean, if it is the right
            place: in pixels of the map image, or in degrees for a pose; None where it is not known.
        taken: where the map image was taken; None where its metadata name no place.
    """

    image: str
    far_from_near: Matrix3 | RelativePose
    footprint: Coordinates | None
    scale_change: float
    confidence: float
    votes: float
    points: PointMatches
    world: GeoPlace | None
    localization: Localization
    images: ImagePair
    alternatives: tuple[Alternative, ...] = ()
    expected_error: float | None = None
    taken: PhotoPosition | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as JSON values."""
        return {
            "image": self.image,
            "far_from_near": self._model_as_dict(),
            "footprint": None if self.footprint is None else self.footprint.tolist(),
            "scale_change": self.scale_change,
            "confidence": self.confidence,
            "votes": self.votes,
            "expected_error": self.expected_error,
            "world": None if self.world is None else self.world.to_dict(),
            "taken": None if self.taken is None else self.taken.to_dict(),
            "alternatives": [
                {"homography": each.far_from_near.tolist(), "score": each.score}
                for each in self.alternatives
            ],
        }

    def picture(self) -> RGBPixels:
        """Draw the query's outline, or else the matched points, on the tile of the map image."""
        part = self.localization
        page = footprint_page(part, self.images, caption=self._caption())
        return point_matches(part, self.images) if page is None else page

    def _caption(self) -> Caption:
        times, size = self.scale_change, "smaller"
        if times < 1:
            times, size = 1 / times, "larger"
        points = self.points
        return Caption(
            f"{Path(self.image).name} shows it inside the outline, {times:.1f} times {size}",
            (
                Entry(f"confidence {self.confidence:.2f}"),
                Entry(f"{points.inliers.sum():,} of {len(points):,} point matches agree"),
            ),
        )

    def _model_as_dict(self) -> dict[str, Any]:
        model = self.far_from_near
        if isinstance(model, RelativePose):
            return {"rotation": model.rotation.tolist(), "translation": model.translation.tolist()}
        return {"homography": np.asarray(model).tolist()}


@dataclass(frozen=True, eq=False)
class UnverifiedPlace:
    """The place in a refused candidate that looks most like the query.

    Attributes:
        far_from_near: homography from pixels of the query to pixels of the original map image.
        footprint: (4, 2) outline of the query in the map image.
        score: share of the query whose features agree there; None where it is not known.
    """

    far_from_near: Matrix3
    footprint: Coordinates
    score: float | None

    def to_dict(self) -> dict[str, Any]:
        """Return the place as JSON values."""
        return {
            "homography": self.far_from_near.tolist(),
            "footprint": self.footprint.tolist(),
            "score": self.score,
        }


@dataclass(frozen=True, eq=False)
class VerifiedCandidate:
    """A candidate that was verified geometrically.

    Attributes:
        image: name of the map image.
        votes: sum of the weights of the query's landmarks that vote for it.
        confidence: calibrated probability that the query lies there; 0 where nothing was found or
            the image could not be read.
        reason: why the candidate is no answer; None where it is one.
        failure: kind of that reason; None where it is an answer or could not be read.
        place: where the query may still lie in the image, which nothing confirms; None where it is
            an answer, or nothing is known.
        unread: whether the file of the map image is missing, has changed or cannot be read.
    """

    image: str
    votes: float
    confidence: float
    reason: str | None
    failure: FailureKind | None = None
    place: UnverifiedPlace | None = None
    unread: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return the candidate as JSON values."""
        return {
            "image": self.image,
            "votes": self.votes,
            "confidence": self.confidence,
            "reason": self.reason,
            "failure": self.failure,
            "place": None if self.place is None else self.place.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class MapLocalization:
    """The result of locating a query in a map: answers, or the reason why there are none.

    Attributes:
        answers: the best first; empty where the query was not found.
        candidates: all candidates that were verified, in that order.
        query: path or URL of the query; None for an array.
        width: width of the original query, in pixels.
        height: height of the original query, in pixels.
        seconds: wall time by stage.
        pose: pose of the query's camera in the frame of a map source; None without the query's
            intrinsics, or where no map image that it lies in has a pose.
        prior: where the query was expected; None where nothing was.
    """

    answers: tuple[MapAnswer, ...]
    candidates: tuple[VerifiedCandidate, ...]
    query: Location | None
    width: int
    height: int
    seconds: dict[str, float]
    pose: QueryPose | None = None
    prior: Prior | None = None

    @property
    def world(self) -> GeoPlace | QueryPose | None:
        """The pose of the query, or else its position on the Earth by the best answer."""
        if self.pose is not None or not self.answers:
            return self.pose
        return self.answers[0].world

    @property
    def located(self) -> bool:
        """Whether there is an answer."""
        return bool(self.answers)

    @property
    def status(self) -> Literal["located", "not found"]:
        """The outcome in words."""
        return "located" if self.located else "not found"

    @property
    def reason(self) -> str | None:
        """Why there is no answer; None where there is one."""
        if self.located:
            return None
        best = self._best
        if best is None and self.prior is not None and self.prior.only:
            return "no photograph of the map was taken near the expected place (--only-near)"
        if best is None:
            return "no landmark of the image is like one of the map"
        return f"none of {len(self.candidates)} candidates; {best.image}: {best.reason}"

    @property
    def unread(self) -> tuple[str, ...]:
        """Why files of candidates could not be read; each reason once."""
        return tuple(
            dict.fromkeys(each.reason for each in self.candidates if each.unread and each.reason)
        )

    @property
    def failure(self) -> FailureKind | None:
        """The kind of that reason; None where there is an answer."""
        if self.located:
            return None
        best = self._best
        return "nothing-agrees" if best is None else best.failure

    @property
    def _best(self) -> VerifiedCandidate | None:
        return max(self.candidates, key=lambda each: each.confidence, default=None)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object that the command line prints with `--json`."""
        return {
            "status": self.status,
            "reason": self.reason,
            "failure": self.failure,
            "query": {
                "path": None if self.query is None else str(self.query),
                "width": self.width,
                "height": self.height,
            },
            "answers": [answer.to_dict() for answer in self.answers],
            "world": None if self.world is None else self.world.to_dict(),
            "candidates": [candidate.to_dict() for candidate in self.candidates],
            "prior": None if self.prior is None else self.prior.to_dict(),
            "seconds": {stage: round(value, 4) for stage, value in self.seconds.items()},
        }

    def to_json(self) -> str:
        """Return `to_dict` as one line of JSON."""
        return json.dumps(self.to_dict(), allow_nan=False)

    def features(self) -> list[dict[str, Any]]:
        """Return a GeoJSON feature (RFC 7946) for each answer in a georeferenced map image.

        A feature is the footprint of the query in longitude and latitude; its properties are
        `query`, `image`, `rank` (1 is the best answer for the query), `confidence`, `scale_change`,
        `centre`, longitude and latitude, and `heading`, `resolution`, `error` and `source` as in
        `GeoPlace`.
        """
        found = []
        for rank, answer in enumerate(self.answers, 1):
            place = answer.world
            seen = None if place is None else place.longitude_latitude
            if place is None or seen is None:
                continue
            properties = {
                "query": None if self.query is None else as_text(str(self.query)),
                "image": answer.image,
                "rank": rank,
                "confidence": answer.confidence,
                "scale_change": answer.scale_change,
                "centre": seen.centre.round(DECIMALS).tolist(),
                "heading": place.heading,
                "resolution": place.resolution,
                "error": place.error,
                "source": place.source,
            }
            polygon = {"type": "Polygon", "coordinates": [ring(seen.footprint)]}
            found.append({"type": "Feature", "geometry": polygon, "properties": properties})
        return found

    def save(self, directory: str | Path, name: str = "location") -> list[Path]:
        """Write `NAME.json` and, where there is an answer, a picture of the best, `NAME.png`.

        Args:
            directory: folder for the files, made where missing.
            name: name of the files without suffix.

        Returns:
            The files written.

        Raises:
            OSError: a file cannot be written.
        """
        folder = Path(directory)
        folder.mkdir(parents=True, exist_ok=True)
        written = [folder / f"{name}.json"]
        with replaced(written[0]) as out:
            out.write_text(self.to_json() + "\n", encoding="utf-8")
        if self.answers:
            picture = self.answers[0].picture()
            written.append(save(picture, folder / f"{name}.png"))
        return written
