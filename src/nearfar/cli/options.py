"""Options that several commands share, and exit statuses."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, Token

from nearfar.errors import ImageError, SettingsError
from nearfar.maps import DEFAULTS, PACKAGES
from nearfar.maps.sources import ImagePoses, read_source
from nearfar.maps.world.prior import Prior
from nearfar.runtime import logs, require
from nearfar.runtime.threads import use_threads
from nearfar.runtime.workers import Workers
from nearfar.settings import Effort, Settings
from nearfar.storage.locations import Url, location

Flag = Annotated[bool, Parameter(negative="", show_default=False)]
"""An option without a value."""

EACH_SETTING = Parameter(
    name="*", group="Settings", parse=re.compile("^(?!(weights|constants|channels)$)")
)
"""Makes each setting one option. `WeightOptions` reads the weights. Constants, and the channels of
arrays, have no options."""

SettingsOptions = Annotated[Settings, EACH_SETTING]
"""Type of an argument that takes each setting as one option."""

WeightOptions = Annotated[
    tuple[str, ...],
    Parameter(name="--weights", negative="", metavar="NAME=FILE", show_default=False),
]
"""Type of an argument that takes the weights of networks, as NAME=FILE."""


CameraOption = Annotated[str | None, Parameter(metavar="CAMERA")]
"""Type of an argument that takes a camera, as a file or in words."""


def _place(_: Any, tokens: Sequence[Token]) -> Path | Url:
    return location(tokens[0].value)


Place = Annotated[Path | Url, Parameter(converter=_place, n_tokens=1, accepts_keys=False)]
"""Type of an argument that is a path, or a URL of object storage."""


@dataclass(frozen=True, kw_only=True)
class Workplace:
    """Options of commands that may share their work between processes or machines."""

    jobs: int = 1
    """Number of local processes that share the work."""

    threads: int | None = None
    """Number of threads for one pair or one query, by default one for each core. Each of several
    --jobs has one."""

    scheduler: str | None = None
    """Address of a Dask scheduler. Its workers do the work instead."""

    log_format: logs.LogFormat = "text"
    """json: write events to the error output, one JSON object a line."""

    def begin(self, extra: str = "bench") -> Workers:
        """Start the log, and return the workers.

        Args:
            extra: see `Workers`.

        Raises:
            SettingsError: the number of jobs is below 1.
        """
        if self.jobs < 1:
            raise SettingsError(f"--jobs must be at least 1, not {self.jobs}")
        self.take_threads()
        logs.start(self.log_format)
        return Workers(self.jobs, self.scheduler, extra)

    def take_threads(self) -> None:
        """Use as many threads as asked for.

        Raises:
            SettingsError: that is less than 1, or there are several jobs, which have one each.
        """
        if self.threads is None:
            return
        if self.jobs > 1 or self.scheduler is not None:
            raise SettingsError("--threads is for one process: leave it out, or --jobs")
        use_threads(self.threads)


WorkOptions = Annotated[Workplace, Parameter(name="*", group="Run")]
DEFAULT_WORK = Workplace()


def with_weights(settings: Settings, weights: tuple[str, ...]) -> Settings:
    """Return the settings with weights that are given as NAME=FILE.

    Raises:
        SettingsError: a weight has another form.
    """
    files = {}
    for item in weights:
        name, equals, file = item.partition("=")
        if not (name and equals and file):
            raise SettingsError(f"--weights needs NAME=FILE, not {item!r}")
        files[name] = Path(file)
    return settings.replace(weights=files)


@Parameter(name="*", group="World coordinates")
@dataclass(frozen=True, kw_only=True)
class WorldOptions:
    """Options that say where cameras and poses of IMAGES are."""

    poses: Annotated[
        tuple[str, ...], Parameter(negative="", metavar="SOURCE=PATH", show_default=False)
    ] = ()
    """Cameras and poses of IMAGES, read by a map source (nearfar list): colmap=FOLDER of a model,
    kitti=FILE or tum=FILE. Lists hold poses from the camera to the world, in the order of IMAGES or
    by their names."""

    intrinsics: CameraOption = None
    """For the map sources kitti and tum, the camera that took IMAGES, without distortion. It is a
    camera as for nearfar localize, or a JSON file {"map": [fx, fy, cx, cy]}."""

    def read(self) -> list[ImagePoses]:
        """Read the sources before a map is built, so that a bad file ends the command at once.

        Raises:
            IntrinsicsError: the intrinsics cannot be read.
            MapError: a model or poses cannot be read.
            SettingsError: there is no such map source, it lacks the intrinsics, or there are
                intrinsics without --poses.
        """
        require("map", *PACKAGES)
        if self.intrinsics is not None and not self.poses:
            raise SettingsError("--intrinsics, of the camera of the map, needs --poses")
        found = []
        for item in self.poses:
            name, equals, path = item.partition("=")
            if not (name and equals and path):
                raise SettingsError(f"--poses needs SOURCE=PATH, e.g. kitti={item}, not {item!r}")
            found.append(read_source(name, path, self.intrinsics))
        return found


NO_WORLD = WorldOptions()


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """How queries are searched in a map."""

    top: int = 1
    """Number of answers to seek: places in different map images, or several in one."""

    candidates: int = 5
    """Number of candidates to verify geometrically, those with most votes. Where no answer is
    confident, as many are verified again with simulated views."""

    near: Annotated[str | None, Parameter(metavar="LAT,LON,RADIUS", allow_leading_hyphen=True)] = (
        None
    )
    """Where the cameras of the queries are expected to have been, in degrees, and how far from it
    they may be, in metres. Photographs taken near it are verified first, then the others."""

    use_gps: Flag = False
    """Expect each query within 100 m of the GPS position in its EXIF data. Queries without one are
    expected at --near."""

    only_near: Flag = False
    """Search only photographs within twice the radius of the expected place."""

    max_effort: Effort = DEFAULTS.max_effort
    """Last step of the method adaptive to try for each candidate."""

    matcher: str = DEFAULTS.matcher
    """What matches a candidate where SIFT is not enough: a learned matcher, or python:module.name
    of your own."""

    device: str = DEFAULTS.device
    """Where learned matchers run: auto, cpu, cuda or mps. auto takes a GPU where there is one."""

    min_confidence: float = DEFAULTS.min_confidence
    """Least calibrated confidence of an answer. Results that chance may explain are never answers,
    whatever it is."""

    max_pixels: int = DEFAULTS.max_pixels
    """Refuse images with more pixels, which may be decompression bombs."""

    bands: str = ""
    """Bands of the queries to show as red, green and blue, such as 4,3,2. One is shown as grey."""

    weights: WeightOptions = ()
    """File of another model of the descriptor, as nearfar=FILE."""

    def settings(self) -> Settings:
        """Return the settings to open a map with.

        Raises:
            SettingsError: a value is out of range.
        """
        if self.top < 1 or self.candidates < 1:
            raise SettingsError("--top and --candidates must be at least 1")
        if self.only_near and self.near is None and not self.use_gps:
            raise SettingsError("--only-near needs an expected place: give --near or --use-gps")
        if self.near is not None:
            Prior.parsed(self.near)
        chosen = DEFAULTS.replace(
            max_effort=self.max_effort,
            matcher=self.matcher,
            device=self.device,
            min_confidence=self.min_confidence,
            max_pixels=self.max_pixels,
            bands=self.bands,
        )
        return with_weights(chosen, self.weights)

    def prior(self, file: Path) -> Prior | None:
        """Return where a query is expected; None where nothing is said.

        Args:
            file: the query.

        Raises:
            ImageError: its metadata cannot be read, or it has no GPS position and images elsewhere
                are not to be searched.
            SettingsError: --near is malformed.
        """
        found = Prior.of_photograph(file, only=self.only_near) if self.use_gps else None
        if found is None and self.near is not None:
            found = Prior.parsed(self.near, only=self.only_near)
        if found is None and self.only_near:
            raise ImageError(f"{file} has no GPS position: give --near, or leave out --only-near")
        return found


DEFAULT_SEARCH = SearchOptions()


BAD_INPUT = 2
"""Exit status after bad input or usage; the error output has one line."""

FAILED = 3
"""Exit status of a valid answer that says "not found"."""
