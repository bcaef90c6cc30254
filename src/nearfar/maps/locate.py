"""Locate a query in a map: candidates by the votes of its landmarks -> verified answers."""

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearfar.arrays import Matrix3
from nearfar.errors import ImageError, MapError
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import footprint, local_scale, normalized, scaling, transform
from nearfar.geometry.intrinsics import CameraIntrinsics
from nearfar.imaging.image import Image, ImagePair, ImageSource, read_image
from nearfar.imaging.mask import MaskedImage, MaskSource
from nearfar.imaging.undistorted import view_of
from nearfar.localization import NO_POINTS, Localization, PointMatches, read_images
from nearfar.localizer import Localizer
from nearfar.maps.answers import MapAnswer, MapLocalization, UnverifiedPlace, VerifiedCandidate
from nearfar.maps.files import file_of, is_unchanged
from nearfar.maps.images import copied, open_image
from nearfar.maps.landmarks import LandmarkDescriber
from nearfar.maps.masks import MaskStore
from nearfar.maps.originals import MapPhotograph, on_earth, place_with_distortion
from nearfar.maps.retrieval import NEAR_ADDED, Retrieval, votes_standing_out
from nearfar.maps.sharing import distinct_places
from nearfar.maps.store import MapStore
from nearfar.maps.tables import MapImage, unpacked_keypoints
from nearfar.maps.verification import Candidate, group_by_tile, localize_in_tile
from nearfar.maps.voting import Hypothesis
from nearfar.maps.world.photo_position import NOWHERE
from nearfar.maps.world.pose_store import PoseStore
from nearfar.maps.world.positions import PositionStore
from nearfar.maps.world.prior import ExpectedPlace, Prior
from nearfar.maps.world.query_pose import VIEWS, Posing
from nearfar.methods.adaptive.pair import AdaptiveFeatures
from nearfar.methods.adaptive.simulated_views import FRONTAL, View, around
from nearfar.models import Alternative
from nearfar.runtime.timing import StageTimer
from nearfar.settings import EFFORTS, Settings

CONFIDENT = 0.9
"""Confidence from which on an answer counts as confident, so that no further one is sought."""
TILTED = around(2, 4)
"""Simulated views of a query without a confident answer: the windows of a map are not tilted."""
SPARSE, SPARSE_TILTED = 4, 2
"""Of the landmarks of a query every so many-th is searched at first, and of its simulated views."""
CACHED_BYTES = 10**8
"""Size of the cache for features of the query and of the tiles that were verified last."""
VERIFIED_CLOSELY = 2
"""Number of candidates, those with most votes, that are verified again by zooming where only an
overlay agrees."""
CANDIDATES_FOR_POSE = 3
"""Retrieve this many times more candidates for a pose, then re-rank them by distance to the first
confident answer: its neighbours show most of the same scene."""
NEAR_TRIED = 3
"""Number of images at the expected place whose points are matched before landmarks are described.
Each costs a fifth of the query without an expected place."""


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
        self._localizer, self._closer = (
            Localizer(each, cache_bytes=CACHED_BYTES, same_place=True, mirror_hints=False)
            for each in (_of_pixels(settings), _closer(_of_pixels(settings)))
        )
        self._quick = Localizer(
            _of_pixels(settings).replace(max_effort="points"),
            cache_bytes=CACHED_BYTES,
            same_place=True,
            mirror_hints=False,
        )
        self._images = {image.id: image for image in store.images() if image.usable}
        self._poses = PoseStore(store.folder)
        self._masks = MaskStore(store.folder)
        self._positions = PositionStore(store.folder).all()

    def locate(
        self,
        source: ImageSource,
        top: int,
        candidates: int,
        camera: CameraIntrinsics | None = None,
        mask: MaskSource | None = None,
        prior: Prior | None = None,
        *,
        simulated_views: bool = True,
        among: Sequence[str] | None = None,
    ) -> MapLocalization:
        """Find where an image lies in the map; see `Map.locate`."""
        timer = StageTimer()
        with timer.stage("reading"):
            image = read_image(
                source,
                max_pixels=self._settings.max_pixels,
                mask=mask,
                bands=self._settings.bands,
                channels=self._settings.channels,
            )
            fitted = None if camera is None else camera.of_size(image.width, image.height, "query")
            view = view_of(image, fitted)
            query, camera = view.image, view.pinhole
        timer.deadline = time.perf_counter() + self._settings.budget
        most = candidates if camera is None else CANDIDATES_FOR_POSE * candidates
        expected = ExpectedPlace.of(prior, self._images, self._positions)
        answers: list[MapAnswer] = []
        verified: list[VerifiedCandidate] = []
        seen: set[MapImage] = set()
        posing = None
        retrieval = Retrieval(
            self._store, self._describer, self._images.keys(), query, expected, timer
        )
        single = top == 1 and camera is None
        for each in _passes(expected, sparse=single, simulated_views=simulated_views):
            if among is not None:
                waiting = self._given(query, among)
            elif not each.views:
                waiting = self._at_place(expected)
            else:
                waiting = retrieval.candidates(each.views, each.every, most)
            standing_out = votes_standing_out(waiting)
            if each.sparse:
                most_voted = waiting[:1] if timer.late else []
                waiting = [one for one in waiting if one.votes >= standing_out] or most_voted
            seen.update(self._images[candidate.image] for candidate in waiting)
            posing = Posing.of(self._poses, seen, camera)
            wanted = top if posing is None else max(top, VIEWS)
            limit = candidates if expected is None else candidates + NEAR_ADDED
            with timer.stage("verification"):
                checked, found = self._verified(waiting, query, posing, wanted, limit, timer)
            verified += checked
            answers += found
            enough = 1 if each.views else wanted
            if among is not None or len(_confident(answers)) >= enough or timer.late:
                break
            if single and any(one.votes >= standing_out for one in found):
                break
        answers = distinct_places(answers)
        photographs = {
            image.name: self._photograph(image)
            for image in self._images.values()
            if image.name in {answer.image for answer in answers[:top]}
        }
        pose = None
        if posing is not None:
            with timer.stage("pose"):
                pose = posing.query_pose(answers, self._settings.seed)
        return MapLocalization(
            on_earth(answers[:top], view, photographs),
            tuple(place_with_distortion(each, view) for each in verified),
            image.path,
            image.width,
            image.height,
            timer.seconds,
            pose,
            prior,
        )

    def _at_place(self, expected: ExpectedPlace | None) -> list[Candidate]:
        """Return the images nearest to the expected place, as a whole, without votes."""
        found = []
        for image in () if expected is None else expected.near[:NEAR_TRIED]:
            tiles = self._store.tiles(image)
            if tiles:
                found.append(Candidate(image, min(tiles, key=lambda each: each.scale), ()))
        return found

    def _given(self, query: Image, names: Sequence[str]) -> list[Candidate]:
        """Return the whole of the map images of some names, in their order.

        Raises:
            MapError: the map has no usable image of a name.
        """
        ids = {image.name: key for key, image in self._images.items()}
        found = []
        for name in names:
            if name not in ids:
                raise MapError(f"the map has no usable image {name!r}: see `nearfar map info`")
            image = self._images[ids[name]]
            whole = scaling(image.width / query.width, image.height / query.height)
            found.append(Hypothesis(image.id, whole, 0.0))
        tiles = {each.image: self._store.tiles(each.image) for each in found}
        return group_by_tile(found, tiles, (query.width, query.height))

    def _verified(
        self,
        waiting: list[Candidate],
        query: Image,
        posing: Posing | None,
        wanted: int,
        most: int,
        timer: StageTimer,
    ) -> tuple[list[VerifiedCandidate], list[MapAnswer]]:
        """Verify at most `most` candidates, until there are `wanted` confident answers.

        After the deadline no further one is verified; the first one always is, by its points.
        """
        verified: list[VerifiedCandidate] = []
        answers: list[MapAnswer] = []
        while waiting and len(verified) < most:
            overlaid = sum(each.failure == "overlay" for each in verified)
            closely = overlaid < VERIFIED_CLOSELY
            candidate = waiting.pop(0)
            checked, places = self._verify(candidate, query, posing, timer, closely=closely)
            verified.append(checked)
            answers += places
            confident = _confident(answers)
            if len(confident) >= wanted or timer.late:
                break
            if posing is not None and len(confident) == 1:
                waiting.sort(
                    key=lambda each: posing.distance(self._images[each.image].name, confident[0])
                )
        return verified, answers

    def _verify(
        self,
        candidate: Candidate,
        query: Image,
        posing: Posing | None,
        timer: StageTimer,
        *,
        closely: bool,
    ) -> tuple[VerifiedCandidate, list[MapAnswer]]:
        """Verify a candidate; also return its places, the best first.

        Args:
            candidate: the candidate.
            query: the query.
            posing: for a pose; None for a homography.
            timer: has the deadline.
            closely: whether to search the tile anew where an overlay was left out, on which the
                votes may have been.
        """
        image = self._images[candidate.image]
        try:
            tile = self._tile(candidate, image)
        except ImageError as error:
            return (
                VerifiedCandidate(image.name, candidate.votes, 0.0, str(error), unread=True),
                [],
            )
        cameras = None if posing is None else posing.cameras(image.name)
        shown = MaskedImage(query.pixels, query.mask)
        localizer = self._localizer if candidate.hypotheses else self._quick
        left = timer.remaining
        found = localize_in_tile(localizer, candidate, tile, shown, cameras, left)
        if found.failure == "overlay" and closely and not timer.late:
            left = timer.remaining
            found = localize_in_tile(self._closer, candidate, tile, shown, cameras, left)
        confidence = found.confidence or 0.0
        checked = VerifiedCandidate(
            image.name,
            candidate.votes,
            confidence,
            found.reason,
            found.failure,
            _unverified(candidate, found),
        )
        if not found.localized:
            return checked, []
        images = read_images(found, (tile.pixels, query.pixels))
        places = [found, *(_at(found, each) for each in range(len(found.alternatives)))]
        return checked, [self._answer(candidate, image, each, images) for each in places]

    def _tile(self, candidate: Candidate, image: MapImage) -> MaskedImage:
        """Return a candidate's tile; give its stored keypoints to the localizer.

        Raises:
            ImageError: the file is missing or has changed since the map was built.
        """
        file = file_of(image.name, self._store.folder)
        if not is_unchanged(file, image):
            raise ImageError(
                f"the file {image.name} is missing or has changed: build the map again"
            )
        known = self._masks.get(image.id)
        given = None if known is None else known.pixels()
        bands = self._store.manifest.bands
        opened = open_image(file, self._settings.max_pixels, given, bands)
        pixels, mask = opened.read(candidate.tile), opened.mask(candidate.tile)
        stored = self._store.keypoints(image.id, candidate.tile)
        if stored is not None:
            seen = read_image(pixels, mask=mask)  # As the localizer reads it.
            features = AdaptiveFeatures(seen.pixels, unpacked_keypoints(stored))
            if seen.mask is not None:
                features = features.masked(seen.mask)
            for localizer in (self._localizer, self._quick):
                localizer.remember(seen, features)
        return MaskedImage(pixels, mask)

    def _answer(
        self, candidate: Candidate, image: MapImage, found: Localization, images: ImagePair
    ) -> MapAnswer:
        model, corners = found.far_from_near, None
        expected = None if found.expected_error is None else found.expected_error.value
        if not isinstance(model, RelativePose):
            model = _in_original(candidate, np.asarray(model))
            corners = footprint(model, found.near.width, found.near.height)
            expected = None if expected is None else expected * candidate.tile.scale
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
            world=None,
            localization=found,
            images=images,
            alternatives=tuple(
                replace(each, far_from_near=_in_original(candidate, each.far_from_near))
                for each in found.alternatives
            ),
            expected_error=expected,
        )

    def _photograph(self, image: MapImage) -> MapPhotograph:
        """Return what is known of a map image as a photograph."""
        file = copied(file_of(image.name, self._store.folder))
        position = self._positions.get(image.id, NOWHERE)
        return MapPhotograph(file, image.width, image.height, position)


@dataclass(frozen=True)
class _Pass:
    """One search of a map for a query.

    Attributes:
        views: views of the query that vote; none for the images at the expected place.
        every: every so many-th landmark of a view votes.
        sparse: whether only candidates whose votes stand out are verified.
    """

    views: Sequence[View]
    every: int = 1
    sparse: bool = False


def _passes(
    expected: ExpectedPlace | None, *, sparse: bool, simulated_views: bool
) -> Iterator[_Pass]:
    """Yield the searches of a map, the cheapest first, until an answer is confident.

    Where no image is left to be searched there is none.

    Args:
        expected: where the query is expected.
        sparse: whether to begin with a part of the landmarks.
        simulated_views: whether to end with simulated views.
    """
    if expected is not None and not expected.weights:
        return
    if expected is not None:
        yield _Pass(())
    if sparse:
        yield _Pass((FRONTAL,), SPARSE, sparse=True)
    yield _Pass((FRONTAL,))
    if simulated_views:
        yield _Pass(TILTED, SPARSE_TILTED)


def _in_original(candidate: Candidate, tile_from_query: Matrix3) -> Matrix3:
    """Return a homography to a tile as one to the original map image."""
    return normalized(candidate.tile.original_from_tile @ tile_from_query)


def _unverified(candidate: Candidate, found: Localization) -> UnverifiedPlace | None:
    """Return the best place that was not accepted, in pixels of the original map image."""
    for each in found.candidates:
        model = _in_original(candidate, each.far_from_near)
        corners = footprint(model, found.near.width, found.near.height)
        if corners is not None:
            return UnverifiedPlace(model, corners, each.score)
    return None


def _at(found: Localization, index: int) -> Localization:
    """Return a localization at one of its alternatives, with the others and itself as its own."""
    chosen = found.alternatives[index]
    middle = np.array([found.near.width - 1, found.near.height - 1]) / 2
    others = tuple(each for each in found.alternatives if each is not chosen)
    itself = Alternative(np.asarray(found.far_from_near), 1.0)
    return replace(
        found,
        far_from_near=chosen.far_from_near,
        footprint=footprint(chosen.far_from_near, found.near.width, found.near.height),
        scale_change=1 / local_scale(chosen.far_from_near, middle),
        confidence=(found.confidence or 0.0) * chosen.score,
        points=NO_POINTS,
        alternatives=(itself, *others),
    )


def _of_pixels(settings: Settings) -> Settings:
    """Return settings for images whose bands and channels are chosen already: arrays of RGB."""
    return settings.replace(bands="", channels="rgb")


def _closer(settings: Settings) -> Settings:
    """Return settings that zoom in at least."""
    least = max(EFFORTS.index("zoom"), EFFORTS.index(settings.max_effort))
    return settings.replace(max_effort=EFFORTS[least])


def _confident(answers: Iterable[MapAnswer]) -> list[str]:
    """Return the images of the confident answers."""
    return [each.image for each in answers if each.confidence >= CONFIDENT]
