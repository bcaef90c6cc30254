"""Other ways to find the image of a map that shows what a query shows."""

from collections.abc import Collection, Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.constants import DEFAULT
from nearfar.features.detection import detect_rootsift
from nearfar.imaging.image import read_image
from nearfar.maps.images import TILE
from nearfar.maps.landmarks import DIMENSIONS, LandmarkDescriber
from nearfar.maps.store import MapStore
from nearfar.maps.tables import MOST, MapImage, unpacked_keypoints
from nearfar.networks.landmark_network import CROP
from nearfar.settings import Settings

Vectors = NDArray[np.float32]

WORDS, SAMPLE, ROUNDS = 16_384, 200_000, 8
"""Words, keypoints that they are learned from, and rounds of k-means."""
AT_ONCE = 2048
"""Keypoints that are compared with all words together."""


def best_first(names: list[str], similarity: NDArray[np.floating]) -> list[str]:
    """The names in the order of falling similarity."""
    return [names[index] for index in np.argsort(-similarity, kind="stable")]


def unit(vectors: NDArray[np.floating]) -> Vectors:
    """Of unit length; zeros stay zeros."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-9), np.float32)


class WholeImage:
    """One landmark vector of the whole image, squeezed into one window; the query in 4 rotations.

    Args:
        files: of the images of the map, by name.
    """

    def __init__(self, files: Mapping[str, Path]) -> None:
        self._describer = LandmarkDescriber(Settings())
        self._names = list(files)
        images = (read_image(file) for file in files.values())
        self._vectors = np.stack([self._vector(image.pixels) for image in images])

    def ranked(self, query: Path) -> list[str]:
        """The images of the map, best first."""
        pixels = read_image(query).pixels
        turned = np.stack([self._vector(np.rot90(pixels, turns)) for turns in range(4)])
        return best_first(self._names, (self._vectors @ turned.T).max(axis=1))

    def _vector(self, pixels: RGBPixels) -> Vectors:
        window = cv2.resize(
            np.ascontiguousarray(pixels), (CROP, CROP), interpolation=cv2.INTER_AREA
        )
        found = self._describer.of_map(np.asarray(window), [1.0])
        return np.asarray(found.vectors.sum(axis=0, dtype=np.float32))  # of one window, or of none


class PooledLandmarks:
    """The mean of all landmark vectors of an image; of the query in each of its rotations.

    Args:
        store: the map, whose landmarks are read.
    """

    def __init__(self, store: MapStore) -> None:
        self._describer = LandmarkDescriber(Settings())
        images = [image for image in store.images() if image.usable]
        self._names = [image.name for image in images]
        row_of = {image.id: row for row, image in enumerate(images)}
        total = np.zeros((len(images), DIMENSIONS))
        for block in store.blocks():
            rows = [row_of[image] for image in block.image.tolist()]
            np.add.at(total, rows, block.vectors)
        self._vectors = unit(total)

    def ranked(self, query: Path) -> list[str]:
        """The images of the map, best first."""
        own = self._describer.of_query(read_image(query).pixels)
        pooled = [
            own.vectors[own.angle == angle].sum(axis=0, dtype=np.float32)
            for angle in np.unique(own.angle)
        ]
        return best_first(self._names, (self._vectors @ unit(np.stack(pooled)).T).max(axis=1))


class BagOfWords:
    """Counts of SIFT words (RootSIFT), square roots weighed by rarity, compared by cosine.

    Args:
        store: the map, whose keypoints are read.
        learned_from: names of the images that the words are learned from.
        file: of the words; made where it is missing.
    """

    def __init__(self, store: MapStore, learned_from: Collection[str], file: Path) -> None:
        images = [image for image in store.images() if image.usable]
        if not file.exists():
            chosen = [image for image in images if image.name in learned_from]
            np.save(file, _words(store, chosen))
        self._words = np.load(file)
        self._names = [image.name for image in images]
        counts = np.stack([self._counts(_keypoints(store, image)) for image in images])
        self._rarity = np.log(len(images) / np.maximum((counts > 0).sum(axis=0), 1))
        self._vectors = unit(np.sqrt(counts) * self._rarity)

    def ranked(self, query: Path) -> list[str]:
        """The images of the map, best first."""
        pixels = read_image(query, max_size=TILE).pixels
        counts = self._counts(detect_rootsift(pixels, DEFAULT.points.contrast, MOST).descriptors)
        return best_first(self._names, self._vectors @ unit(np.sqrt(counts) * self._rarity))

    def _counts(self, vectors: Vectors) -> Vectors:
        return np.bincount(_nearest(vectors, self._words), minlength=WORDS).astype(np.float32)


def _keypoints(store: MapStore, image: MapImage) -> Vectors:
    """The vectors of the keypoints of all tiles of an image."""
    stored = [store.keypoints(image.id, tile) for tile in store.tiles(image.id)]
    return np.vstack([unpacked_keypoints(each).descriptors for each in stored if each is not None])


def _words(store: MapStore, images: list[MapImage]) -> Vectors:
    """Centres of clusters of keypoints (Lloyd's algorithm), as many drawn from each image."""
    rng = np.random.default_rng(0)
    drawn = []
    for image in images:
        vectors = _keypoints(store, image)
        drawn.append(rng.permutation(vectors)[: SAMPLE // len(images)])
    sample = np.vstack(drawn)
    words = rng.permutation(sample)[:WORDS]
    for _ in range(ROUNDS):
        word = _nearest(sample, words)
        order = np.argsort(word, kind="stable")
        starts = np.flatnonzero(np.diff(word[order], prepend=-1))
        words[word[order][starts]] = unit(np.add.reduceat(sample[order], starts))
    return words


def _nearest(vectors: Vectors, words: Vectors) -> NDArray[np.intp]:
    """(N,) the word that is most like each vector; all are of unit length."""
    parts = [
        (vectors[start : start + AT_ONCE] @ words.T).argmax(axis=1)
        for start in range(0, len(vectors), AT_ONCE)
    ]
    return np.concatenate([np.empty(0, np.intp), *parts])
