"""Places of frames on the Earth, and the height of the camera over the ground."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nearfar.errors import ImageError, MapError
from nearfar.geometry.camera_files import CameraSource, read_camera
from nearfar.geometry.intrinsics import CameraIntrinsics, Intrinsics
from nearfar.imaging.georeference import Georeference, georeference
from nearfar.maps.files import file_of
from nearfar.maps.images import copied
from nearfar.maps.world.places import geo_place_in
from nearfar.storage.locations import Location
from nearfar.tracking.place import half_diagonal
from nearfar.tracking.state import TrackState

UNCERTAIN = float(np.sqrt(np.pi / 2))
"""Mean length of a normally distributed displacement, in its standard deviation along an axis."""


class Earth:
    """The georeferences of the images of a map, each read once.

    Args:
        folder: folder of the map.
    """

    def __init__(self, folder: Location) -> None:
        self._folder = folder
        self._known: dict[str, Georeference | None] = {}

    def placed(
        self, state: TrackState, camera: CameraIntrinsics | None, radius: float
    ) -> TrackState:
        """Return a state with its place on the Earth, if its map image is georeferenced.

        Args:
            state: the state.
            camera: camera of the frame; None where it is not known.
            radius: half diagonal of the footprint, in map pixels.

        Raises:
            MapError: the georeference cannot be read.
            MissingExtraError: the extra `geo` is not installed.
        """
        if state.image is None or state.far_from_near is None or state.covariance is None:
            return state
        if state.image not in self._known:
            file = copied(file_of(state.image, self._folder))
            try:
                self._known[state.image] = georeference(file)
            except ImageError as error:
                raise MapError(str(error)) from error
        place = self._known[state.image]
        if place is None:
            return state
        expected = state.expected_error
        if expected is None:
            turned = radius**2 * np.diag(state.covariance)[2:].sum()
            expected = UNCERTAIN * float(np.sqrt(np.diag(state.covariance)[:2].mean() + turned))
        found = geo_place_in(
            place, state.far_from_near, state.size, Intrinsics(None, camera), expected
        )
        height = None
        if found is not None and found.resolution is not None and camera is not None:
            height = found.resolution * (camera.fx + camera.fy) / 2
        return replace(state, world=found, height=height)


def placed_on_earth(
    states: Sequence[TrackState], folder: Location, intrinsics: CameraSource | None
) -> list[TrackState]:
    """Return states, such as smoothed ones, with the places on the Earth of their homographies.

    Args:
        states: of the frames.
        folder: folder of the map.
        intrinsics: camera of the frames, see `Tracker`; None where it is not known.

    Raises:
        IntrinsicsError: the intrinsics cannot be read.
        MapError: the georeference cannot be read.
        MissingExtraError: the extra `geo` is not installed.
    """
    earth = Earth(folder)
    camera = None if intrinsics is None else read_camera(intrinsics, "query")
    found = []
    for state in states:
        if state.far_from_near is None:
            found.append(state)
            continue
        fitted = None if camera is None else camera.of_size(*state.size, "query")
        radius = half_diagonal(state.far_from_near, state.size)
        found.append(earth.placed(replace(state, world=None, height=None), fitted, radius))
    return found
