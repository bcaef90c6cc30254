"""What locating a query needs where its camera and those of map images are known."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from nearfar.geometry.pose import RelativePose
from nearfar.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.maps.answers import MapAnswer
from nearfar.maps.entries import MapImage
from nearfar.maps.world.places import QueryPose
from nearfar.maps.world.query_pose import query_pose
from nearfar.maps.world.scene import ViewMatches
from nearfar.maps.world.views import View, ViewStore

VIEWS = 3
"""Map images that are sought for a pose: it takes two to triangulate."""


@dataclass(frozen=True, eq=False)
class Posing:
    """The cameras of a query and of the map images that it may lie in.

    Attributes:
        camera: of the query, in its pixels.
        views: by name of the map image.
    """

    camera: CameraIntrinsics
    views: dict[str, View]

    @staticmethod
    def of(
        store: ViewStore, images: Iterable[MapImage], camera: CameraIntrinsics | None
    ) -> "Posing | None":
        """What is known; None where the query's camera, or that of all the images, is not."""
        if camera is None:
            return None
        names = {image.id: image.name for image in images}
        views = {names[key]: view for key, view in store.get(list(names)).items()}
        return Posing(camera, views) if views else None

    def cameras(self, image: str) -> Intrinsics | None:
        """Of a map image (far) and the query (near); None where that of the image is not known."""
        view = self.views.get(image)
        return None if view is None else Intrinsics(view.camera, self.camera)

    def apart(self, image: str, other: str) -> float:
        """Distance between the cameras of two map images; infinite where it is not known."""
        first, second = self.views.get(image), self.views.get(other)
        if first is None or second is None or first.world != second.world:
            return math.inf
        return float(np.linalg.norm(first.centre - second.centre))

    def query_pose(self, answers: Sequence[MapAnswer], seed: int) -> QueryPose | None:
        """The pose of the query.

        Args:
            answers: best first.
            seed: of every random choice.
        """
        matches = [
            _matches(answer, self.views[answer.image])
            for answer in answers
            if answer.image in self.views
        ]
        return query_pose(matches, self.camera, seed)


def _matches(answer: MapAnswer, view: View) -> ViewMatches:
    points, found = answer.points, answer.localization
    working = found.near.width / found.near.pixels.shape[1]
    model = answer.far_from_near
    return ViewMatches(
        answer.image,
        view,
        points.far[points.inliers],
        points.near[points.inliers],
        max(working, found.scale_change or 0.0),
        model if isinstance(model, RelativePose) else None,
    )
