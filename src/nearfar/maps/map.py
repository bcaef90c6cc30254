"""A map: many images, in which other images are located."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike

from nearfar.errors import MapError, SettingsError
from nearfar.geometry.camera_files import CameraSource, read_camera
from nearfar.imaging.image import ImageSource
from nearfar.imaging.mask import MaskSource
from nearfar.maps.answers import MapLocalization
from nearfar.maps.build import Added, add_images
from nearfar.maps.creation import create
from nearfar.maps.files import Problem, check_map, name_of
from nearfar.maps.images import ImageFiles, given_files, image_files
from nearfar.maps.locate import MapLocator
from nearfar.maps.manifest import FILE, Manifest, manifest_for
from nearfar.maps.masks import MaskStore, mask_files
from nearfar.maps.sources import GivenImage, ImagePoses
from nearfar.maps.store import MapStore
from nearfar.maps.tables import MapImage
from nearfar.maps.world.pose_store import PoseStore
from nearfar.maps.world.positions import PositionStore
from nearfar.maps.world.prior import Prior
from nearfar.maps.world.scene import PosedImage
from nearfar.runtime.logs import Progress, silent
from nearfar.runtime.workers import Workers
from nearfar.settings import Settings
from nearfar.storage.locations import Location, location

TOP, CANDIDATES = 1, 5
"""Default number of answers to seek, and of candidates to verify."""


class Map:
    """An open map: its images as they were when it was opened, and the changes made since then.

    A `Map` must not be used by several threads at once; each can open the map for itself. Every
    method raises `StorageError` where the map is in object storage that does not answer.

    Args:
        folder: folder of the map.
        settings: settings of the method `adaptive`, which verifies candidates; `weights` can name
            another model of the descriptor.

    Raises:
        MapError: there is no map, or it has another format.
        SettingsError: the settings are for another method.
    """

    def __init__(self, folder: Location, settings: Settings) -> None:
        if settings.method != "adaptive":
            raise SettingsError(f"a map is searched by the method adaptive, not {settings.method}")
        self.settings = settings
        self._store = MapStore(folder)
        self._locator: MapLocator | None = None

    @staticmethod
    def create(folder: Location, settings: Settings, max_size: int) -> "Map":
        """Make a map without images.

        Raises:
            MapError: the folder holds something else.
            SettingsError: `max_size` is below 0.
            WeightsError: the weights of the descriptor cannot be read.
            OSError: the folder cannot be made.
        """
        if max_size < 0:
            raise SettingsError(f"max_size must be at least 0, not {max_size}")
        create(folder, manifest_for(settings, max_size))
        return Map(folder, settings)

    @staticmethod
    def exists(folder: Location) -> bool:
        """Whether a folder is a map, of any format."""
        return (folder / FILE).exists()

    @property
    def folder(self) -> Location:
        """The folder of the map."""
        return self._store.folder

    @property
    def manifest(self) -> Manifest:
        """The format, descriptor and image size that the map was made with."""
        return self._store.manifest

    @property
    def images(self) -> tuple[MapImage, ...]:
        """All images, also those that could not be read, sorted by name."""
        return tuple(self._store.images())

    def locate(
        self,
        image: ImageSource,
        *,
        top: int = TOP,
        candidates: int = CANDIDATES,
        intrinsics: CameraSource | None = None,
        mask: MaskSource | None = None,
        simulated_views: bool = True,
        prior: Prior | None = None,
        among: Sequence[str] | None = None,
    ) -> MapLocalization:
        """Find where an image lies in the map.

        Args:
            image: path or array (RGB).
            top: number of answers to seek, in different map images or at several places of one.
            candidates: number of candidates to verify, those with most votes. Where no answer is
                confident, as many are verified again with simulated views of the image.
            intrinsics: camera that took the image, "query" of a file or mapping. With it, and map
                images whose poses are known, the result has the pose of the image.
            mask: file or array as large as the image, 0 where it must not be used. Transparent
                pixels are not used either.
            simulated_views: whether to search again with simulated views of the image where no
                answer is confident, which takes several times as long.
            prior: where the camera of the image is expected to have been. Map images that were
                taken near it are verified first; the others follow, unless the prior leaves them
                out.
            among: names of the map images that are verified, in this order, where it is known
                which may show the image; None searches all.

        Returns:
            The answers, best first; without answers where the image was not found.

        Raises:
            ImageError: the image or its mask cannot be read, or the mask has another size.
            IntrinsicsError: the intrinsics cannot be read.
            MapError: the map was made with another descriptor, or has no image of a name, or there
                is a prior and no position of any map image is known.
            SettingsError: a number is below 1.
            WeightsError: the weights of the descriptor cannot be read.
        """
        if top < 1 or candidates < 1:
            raise SettingsError("top and candidates must be at least 1")
        if self._locator is None:
            self._locator = MapLocator(self._store, self.settings)
        camera = None if intrinsics is None else read_camera(intrinsics, "query")
        if prior is not None and not self.placed:
            raise MapError(
                f"the map {self.folder} knows no place of its images: add photographs with GPS tags"
            )
        return self._locator.locate(
            image,
            top,
            candidates,
            camera,
            mask,
            prior,
            simulated_views=simulated_views,
            among=among,
        )

    def add(
        self,
        images: ImageFiles,
        *,
        jobs: int = 1,
        scheduler: str | None = None,
        progress: Progress = silent,
        masks: str | PathLike[str] | None = None,
    ) -> Added:
        """Add images; leave those that the map has already, and replace those that have changed.

        An index is built where 200,000 landmarks have none.

        Args:
            images: files, folders, of which all images are added, and patterns such as
                `photos/*.jpg`; paths, or URLs of object storage; or an `ImageSet`.
            jobs: number of local processes.
            scheduler: address of a Dask cluster whose workers describe the images instead; they
                read the files at the same paths.
            progress: is called with the number of images done and of all images.
            masks: folder of masks in COLMAP's naming: the mask of `a/b.jpg` is `a/b.jpg.png`, as
                large as the image and 0 where it must not be used. Paths are relative to the
                folder that is given in `images`. Images whose mask has changed are replaced. None
                leaves the masks of images that are there already.

        Raises:
            ClusterError: the cluster cannot be used.
            MapError: a file does not exist, another process is writing, the map was made with
                another descriptor, or its tables cannot be written, e.g. on a full disk. Images
                that were committed are kept.
            ImageError: there is no folder `masks`.
            SettingsError: `jobs` is below 1.
            WeightsError: the weights of the descriptor cannot be read.
        """
        if jobs < 1:
            raise SettingsError("jobs must be at least 1")
        self.manifest.check_model(self.settings, self.folder)
        files = given_files(images)
        masked = None if masks is None else mask_files(images, masks)
        workers = Workers(jobs, scheduler, extra="map")
        with self._changing():
            added = add_images(self._store, files, self.settings, workers, progress, masked)
            self._store.index()
            return added

    def attach(self, source: ImagePoses, images: ImageFiles) -> int:
        """Attach the cameras and poses of a map source to images of the map.

        Args:
            source: what `nearfar.maps.sources.read_source` returns, or poses of your own.
            images: images that were added, in the order of the source where it has no names.

        Returns:
            Number of images that have a pose by the source now.

        Raises:
            MapError: no image has a pose in the source, it does not fit the images, gives
                something else than poses of them, or another process is writing.
        """
        files, world = image_files(images), name_of(source.path, self.folder)
        with self._changing():
            ids = {image.name: image.id for image in self.images}
            usable = {image.name: image for image in self.images if image.usable}
            given = []
            for file in files:
                name = name_of(file, self.folder)
                image = usable.get(name)
                size = (0, 0) if image is None else (image.width, image.height)
                given.append(GivenImage(name, *size, file))
            poses = source.posed(given)
            for name, posed in poses.items():
                if name not in usable or not isinstance(posed, PosedImage) or not posed.valid:
                    raise MapError(f"the map source {source.path} gives no valid pose of {name!r}")
            store = PoseStore(self.folder)
            store.put({ids[name]: replace(each, world=world) for name, each in poses.items()})
            store.remove(store.ids() - set(ids.values()))
            return len(poses)

    def remove(self, names: Iterable[str | PathLike[str]]) -> int:
        """Remove images; their files are left.

        Args:
            names: names of images in the map, or paths of their files.

        Returns:
            Number of images that were removed.

        Raises:
            MapError: an image is not in the map, or another process is writing; nothing is removed.
        """
        with self._changing():
            ids = {image.name: image.id for image in self._store.images()}
            chosen = {self._id_of(str(name), ids) for name in names}
            self._store.remove(chosen)
            PoseStore(self.folder).remove(chosen)
            left = [image.id for image in self._store.images()]
            MaskStore(self.folder).keep(left)
            PositionStore(self.folder).keep(left)
        return len(chosen)

    @property
    def posed(self) -> set[int]:
        """Ids of the images with a known camera and pose."""
        return PoseStore(self.folder).ids()

    @property
    def placed(self) -> set[int]:
        """Ids of the images that name the place where they were taken."""
        found = PositionStore(self.folder).all()
        return {image for image, position in found.items() if position.known}

    def check(self, *, content: bool = False) -> list[Problem]:
        """Return the problems of the map, of the files of its images and of their poses.

        Args:
            content: also read files whose size and time have not changed.
        """
        return check_map(self._store, content=content)

    def compact(self) -> bool:
        """Merge the files of the map, remove old ones, and index the landmarks of a large map.

        Files that only readers of an older state need are removed after an hour.

        Returns:
            Whether the landmarks have an index.

        Raises:
            MapError: another process is writing.
        """
        with self._changing():
            return self._store.compact()

    @contextmanager
    def _changing(self) -> Iterator[None]:
        """Be the only writer, and drop what the locator has cached."""
        with self._store.writing():
            self._locator = None
            yield

    def _id_of(self, name: str, ids: dict[str, int]) -> int:
        of_file = name_of(location(name), self.folder)
        for known in (name, of_file):
            if known in ids:
                return ids[known]
        raise MapError(f"{name!r} is not in the map {self.folder}: see `nearfar map info`")
