"""Folders of masks, named as COLMAP names them: the mask of `a/b.jpg` is `MASKS/a/b.jpg.png`."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePath

from nearfar.errors import ImageError


@dataclass(frozen=True)
class MaskFolder:
    """A folder of masks; an image without a mask in it is used as a whole.

    Attributes:
        folder: the folder, in which sub-folders are those of the images.
    """

    folder: Path

    @staticmethod
    def opened(folder: str | PathLike[str]) -> "MaskFolder":
        """Return a folder that exists.

        Raises:
            ImageError: it is none.
        """
        path = Path(folder)
        if not path.is_dir():
            raise ImageError(f"there is no folder {path} of masks: name one that exists")
        return MaskFolder(path)

    def mask_of(self, image: PurePath | str) -> Path | None:
        """Return the file of an image's mask; None where there is none.

        Args:
            image: path of the image, relative to the folder of all images.
        """
        name = PurePath(image)
        if name.is_absolute() or ".." in name.parts:
            return None
        file = self.folder / f"{name}.png"
        return file if file.exists() else None
