"""Locate a query in a map: landmarks -> hits -> votes -> candidates -> verified answers."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from nearfar.arrays import Matrix3, RGBPixels
from nearfar.errors import ImageError
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint, normalized, transform
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.image import Image, ImagePair, ImageSource, read_image
from nearfar.imaging.warp import resized
from nearfar.localization import Localization, PointMatches, read_images
from nearfar.localizer import Localizer
from nearfar.maps.answers import MapAnswer, MapLocalization, VerifiedCandidate
from nearfar.maps.files import file_of, is_unchanged
from nearfar.maps.images import copied, open_image
from nearfar.maps.landmarks import QUERY_SIDES, LandmarkDescriber, Landmarks
from nearfar.maps.search import Hits, nearest, nearest_by_index
from nearfar.maps.store import MapStore
from nearfar.maps.tables import MapImage, unpacked_keypoints
from nearfar.maps.verification import Candidate, group_by_tile, localize_in_tile
from nearfar.maps.voting import Hypothesis, find_hypotheses, votes_of
from nearfar.maps.world.places import geo_place
from nearfar.maps.world.pose_store import PoseStore
from nearfar.maps.world.query_pose import VIEWS, Posing
from nearfar.methods.adaptive.pair import AdaptiveFeatures
from nearfar.methods.adaptive.simulated_views import FRONTAL, View, around, simulate
from nearfar.runtime.timing import StageTimer
from nearfar.settings import Settings

HITS = 20
"""Number of nearest map landmarks for each landmark of a query."""
HYPOTHESES_PER_CANDIDATE = 3
"""Number of hypotheses that are considered for each candidate that may be verified."""
CONFIDENT = 0.9
"""Confidence from which on an answer counts as confident, so that no further one is sought."""
TILTED = around(2, 4)
"""Simulated views of a query without a confident answer: the windows of a map are not tilted."""
VIEW_SIDE = 2 * max(QUERY_SIDES)
"""Longest side in pixels of the image that views are simulated from."""
CACHED_BYTES = 10**8
"""Size of the cache for features of the query and of the tiles that were verified last."""
CANDIDATES_FOR_POSE = 3
"""Retrieve this many times more candidates for a pose, then re-rank them by distance to the first
confident answer: its neighbours show most of the same scene."""


class MapLocator:
    """Locates queries in a map.

    Args:
        store: the tables of the map.
        settings: settings of the method `adaptive`, which verifies candidates.

    Raises:
        MapError: the map was made with another descriptor.
        WeightsError: the file of the descriptor cannot be read.
    """

    def __init__(self, store: MapStore, settings: Settings) -> None:
        store.manifest.check_model(settings, store.folder)
        self._store = store
        self._settings = settings
        self._describer = LandmarkDescriber(settings)
        self._localizer = Localizer(settings, cache_bytes=CACHED_BYTES, same_place=True)
        self._images = {image.id: image for image in store.images() if image.usable}
        self._poses = PoseStore(store.folder)

    def locate(
        self, source: ImageSource, top: int, candidates: int, camera: CameraIntrinsics | None = None
    ) -> MapLocalization:
        """Find where an image lies in the map; see `Map.locate`."""
        timer = StageTimer()
        with timer.stage("reading"):
            query = read_image(source, max_pixels=self._settings.max_pixels)
        most = candidates if camera is None else CANDIDATES_FOR_POSE * candidates
        answers: list[MapAnswer] = []
        verified: list[VerifiedCandidate] = []
        seen: set[MapImage] = set()
        for views in ((FRONTAL,), TILTED):
            waiting = self._candidates(query, views, most, timer)
            seen.update(self._images[candidate.image] for candidate in waiting)
            posing = Posing.of(self._poses, seen, camera)
            wanted = top if posing is None else max(top, VIEWS)
            with timer.stage("verification"):
                checked, found = self._verified(waiting, query, posing, wanted, candidates)
            verified += checked
            answers += found
            if _confident(answers):
                break
        answers.sort(key=lambda each: (-each.confidence, -each.votes))
        pose = None
        if posing is not None:
            with timer.stage("pose"):
                pose = posing.query_pose(answers, self._settings.seed)
        return MapLocalization(
            tuple(answers[:top]),
            tuple(verified),
            query.path,
            query.width,
            query.height,
            timer.seconds,
            pose,
        )

    def _candidates(
        self, query: Image, views: Sequence[View], most: int, timer: StageTimer
    ) -> list[Candidate]:
        """Return the tiles of map images that most votes of the query's views are for."""
        found: list[Hypothesis] = []
        for view in views:
            with timer.stage("landmarks"):
                pixels, view_from_query = _seen(query, view)
                landmarks = self._describer.of_query(pixels)
            with timer.stage("search"):
                hits = self._hits(landmarks)
            with timer.stage("votes"):
                size = pixels.shape[1], pixels.shape[0]
                votes = votes_of(hits, landmarks, size)
                found += [
                    replace(each, map_from_query=each.map_from_query @ view_from_query)
                    for each in find_hypotheses(votes, size, HYPOTHESES_PER_CANDIDATE * most)
                ]
        found = sorted(found, key=lambda each: -each.votes)[: HYPOTHESES_PER_CANDIDATE * most]
        with timer.stage("votes"):
            tiles = {each: self._store.tiles(each) for each in {one.image for one in found}}
            return group_by_tile(found, tiles, (query.width, query.height))[:most]

    def _hits(self, landmarks: Landmarks) -> Hits:
        if self._store.indexed:
            return nearest_by_index(self._store, landmarks.vectors, HITS, self._images)
        return nearest(self._store.blocks(), landmarks.vectors, HITS, self._images)

    def _verified(
        self, waiting: list[Candidate], query: Image, posing: Posing | None, wanted: int, most: int
    ) -> tuple[list[VerifiedCandidate], list[MapAnswer]]:
        """Verify at most `most` candidates, until there are `wanted` confident answers."""
        verified: list[VerifiedCandidate] = []
        answers: list[MapAnswer] = []
        while waiting and len(verified) < most:
            checked, answer = self._verify(waiting.pop(0), query, posing)
            verified.append(checked)
            if answer is not None:
                answers.append(answer)
            confident = _confident(answers)
            if len(confident) >= wanted:
                break
            if posing is not None and len(confident) == 1:
                waiting.sort(
                    key=lambda each: posing.distance(self._images[each.image].name, confident[0])
                )
        return verified, answers

    def _verify(
        self, candidate: Candidate, query: Image, posing: Posing | None
    ) -> tuple[VerifiedCandidate, MapAnswer | None]:
        """Verify a candidate; also return its answer, None where it is none."""
        image = self._images[candidate.image]
        try:
            pixels = self._pixels(candidate, image)
        except ImageError as error:
            return VerifiedCandidate(image.name, candidate.votes, 0.0, str(error)), None
        cameras = None if posing is None else posing.cameras(image.name)
        found = localize_in_tile(self._localizer, candidate, pixels, query.pixels, cameras)
        confidence = found.confidence or 0.0
        checked = VerifiedCandidate(image.name, candidate.votes, confidence, found.reason)
        if not found.localized:
            return checked, None
        images = read_images(found, (pixels, query.pixels))
        return checked, self._answer(candidate, image, found, images)

    def _pixels(self, candidate: Candidate, image: MapImage) -> RGBPixels:
        """Return the pixels of a candidate; give its stored keypoints to the localizer.

        Raises:
            ImageError: the file is missing or has changed since the map was built.
        """
        file = file_of(image.name, self._store.folder)
        if not is_unchanged(file, image):
            raise ImageError(
                f"the file {image.name} is missing or has changed: build the map again"
            )
        pixels = open_image(file, self._settings.max_pixels).read(candidate.tile)
        stored = self._store.keypoints(image.id, candidate.tile)
        if stored is not None:
            height, width = pixels.shape[:2]
            features = AdaptiveFeatures(pixels, unpacked_keypoints(stored))
            self._localizer.remember(Image(pixels, width, height, None), features)
        return pixels

    def _answer(
        self, candidate: Candidate, image: MapImage, found: Localization, images: ImagePair
    ) -> MapAnswer:
        model, corners, world = found.far_from_near, None, None
        if not isinstance(model, RelativePose):
            size = found.near.width, found.near.height
            model = normalized(candidate.tile.original_from_tile @ np.asarray(model))
            corners = footprint(model, *size)
            world = geo_place(copied(file_of(image.name, self._store.folder)), model, size)
        points = found.points
        in_original = transform(candidate.tile.original_from_tile, points.far)
        return MapAnswer(
            image=image.name,
            far_from_near=model,
            footprint=corners,
            scale_change=(found.scale_change or math.nan) * candidate.tile.scale,
            confidence=found.confidence or 0.0,
            votes=candidate.votes,
            points=PointMatches(in_original, points.near, points.inliers),
            world=world,
            localization=found,
            images=images,
        )


def _confident(answers: Iterable[MapAnswer]) -> list[str]:
    """Return the images of the confident answers."""
    return [each.image for each in answers if each.confidence >= CONFIDENT]


def _seen(query: Image, view: View) -> tuple[RGBPixels, Matrix3]:
    """Return a view of the query, and the transform from pixels of the query to the view."""
    if view == FRONTAL:
        return query.pixels, np.eye(3)
    reduced, reduced_from_query = resized(
        query.pixels, min(1.0, VIEW_SIDE / max(query.width, query.height))
    )
    pixels, view_from_reduced = simulate(reduced, view)
    return pixels, view_from_reduced @ reduced_from_query
