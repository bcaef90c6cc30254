"""What a map costs per image and per landmark vector, and what that makes of a million images.

    python benchmarks/map_scale.py IMAGES SCRATCH [--vectors 12000 50000 200000] [--max-size 400]

IMAGES are described once; for larger maps their landmarks are taken again with other vectors, each
turned at random so that its cosine with the real one is 0.8. Queries are images that the maps do
not hold. The line through the two smallest maps is compared with each larger one. One JSON object a
measurement; SCRATCH is left as it was.
"""

import argparse
import json
import resource
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.imaging.image import read_image
from nearfar.maps import DEFAULTS
from nearfar.maps.build import LANDMARKS_PER_COMMIT, _indexed, _Task
from nearfar.maps.creation import create
from nearfar.maps.images import image_files
from nearfar.maps.landmarks import LandmarkDescriber, Landmarks
from nearfar.maps.manifest import manifest_for
from nearfar.maps.retrieval import HITS
from nearfar.maps.search import Hits, nearest, nearest_by_index
from nearfar.maps.store import MapStore
from nearfar.maps.tables import Indexed
from nearfar.settings import Settings

COSINE = 0.8
QUERY_VECTORS = 256
PER_QUERY = 4
"""Queries that are timed."""
MILLION = 1_000_000
EXTRAPOLATED = (
    "add_seconds",
    "vector_bytes",
    "exact_seconds",
    "index_seconds",
    "indexed_seconds",
    "index_bytes",
)
"""That are taken to grow with the vectors."""


@dataclass(frozen=True)
class Cost:
    """Of one size of a map; seconds and bytes."""

    vectors: int
    images: int
    add_seconds: float
    commit_seconds_last: float
    compact_seconds: float
    disk_bytes: int
    vector_bytes: int
    open_seconds: float
    exact_seconds: float
    index_seconds: float
    index_bytes: int
    indexed_seconds: float
    recall: float
    peak_memory_bytes: int


def described(files: list[Path], max_size: int, settings: Settings) -> tuple[list[Indexed], float]:
    """What a map would hold of each image, and seconds an image."""
    begun = time.process_time()
    found = [_indexed(_Task(file, file.name, None, max_size, "", settings)) for file in files]
    seconds = (time.process_time() - begun) / len(files)
    return [each for each in found if isinstance(each, Indexed) and each.image.usable], seconds


def copies(real: list[Indexed], vectors: int, seed: int) -> Iterator[Indexed]:
    """The images, then copies of them with other vectors, until there are so many vectors."""
    random, made, number = np.random.default_rng(seed), 0, 0
    while made < vectors:
        original = real[number % len(real)]
        landmarks = original.landmarks[np.arange(min(len(original.landmarks), vectors - made))]
        if number >= len(real):
            landmarks = replace(landmarks, vectors=turned(landmarks.vectors, random))
        name = f"{number:08}-{original.image.name}"
        image = replace(original.image, id=number, name=name, landmarks=len(landmarks))
        yield Indexed(image, original.tiles, landmarks)
        made, number = made + len(landmarks), number + 1


def turned(vectors: NDArray[np.float16], random: np.random.Generator) -> NDArray[np.float16]:
    """Unit vectors whose cosine with those given is `COSINE`."""
    exact = vectors.astype(np.float32)
    noise = random.standard_normal(exact.shape, np.float32)
    noise -= (noise * exact).sum(axis=1, keepdims=True) * exact
    noise /= np.linalg.norm(noise, axis=1, keepdims=True)
    return np.asarray(COSINE * exact + np.sqrt(1 - COSINE**2) * noise, np.float16)


def measured(
    folder: Path, real: list[Indexed], queries: list[Landmarks], vectors: int, settings: Settings
) -> Cost:
    """Build a map of so many vectors and ask it."""
    create(folder, manifest_for(settings, 0))
    store = MapStore(folder)
    images, add_seconds, last = 0, 0.0, 0.0
    with store.writing():
        for entries in commits(copies(real, vectors, vectors)):
            images += len(entries)
            last = timed(lambda entries=entries: store.add(entries))
            add_seconds += last
        compact_seconds = timed(lambda: store.compact(index_from=vectors + 1))
    disk = size_of(folder)
    vector_bytes = size_of(folder / "landmarks.lance")
    open_seconds = timed(lambda: MapStore(folder))
    known = {image.id for image in store.images()}
    exact: list[Hits] = []
    exact_seconds = timed(
        lambda: exact.extend(nearest(store.blocks(), each.vectors, HITS, known) for each in queries)
    )
    with store.writing():
        index_seconds = timed(lambda: store.compact(index_from=0))
    index_bytes = size_of(folder / "landmarks.lance" / "_indices")
    quick: list[Hits] = []
    indexed_seconds = timed(
        lambda: quick.extend(nearest_by_index(store, each.vectors, HITS, known) for each in queries)
    )
    recall = np.mean([shared(a, b) for a, b in zip(exact, quick, strict=True)])
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return Cost(
        store.landmark_count(),
        images,
        add_seconds,
        last,
        compact_seconds,
        disk,
        vector_bytes,
        open_seconds,
        exact_seconds / len(queries),
        index_seconds,
        index_bytes,
        indexed_seconds / len(queries),
        float(recall),
        memory,
    )


def commits(entries: Iterator[Indexed]) -> Iterator[list[Indexed]]:
    """What is committed together."""
    waiting: list[Indexed] = []
    for entry in entries:
        waiting.append(entry)
        if sum(len(each.landmarks) for each in waiting) >= LANDMARKS_PER_COMMIT:
            yield waiting
            waiting = []
    if waiting:
        yield waiting


def shared(exact: Hits, quick: Hits, count: int = 10) -> float:
    """Mean share of the ten best that the index finds among its ten best."""
    shares = []
    for row in range(len(exact.image)):
        sets = [
            {(int(image), *place.tolist()) for image, place in zip(*parts, strict=True)}
            for parts in (
                (exact.image[row, :count], exact.place[row, :count]),
                (quick.image[row, :count], quick.place[row, :count]),
            )
        ]
        shares.append(len(sets[0] & sets[1]) / len(sets[0]))
    return float(np.mean(shares))


def extrapolated(costs: list[Cost], images: float, vectors: float) -> dict[str, float]:
    """Each cost at another size, by the line through the first and the last of those given."""
    small, large = costs[0], costs[-1]

    def at(name: str) -> float:
        low, high = getattr(small, name), getattr(large, name)
        slope = (high - low) / (large.vectors - small.vectors)
        return float(high + slope * (vectors - large.vectors))

    tiles = (large.disk_bytes - large.vector_bytes) / large.images
    return {"images": images, "vectors": vectors, "tile_bytes": tiles * images} | {
        name: at(name) for name in EXTRAPOLATED
    }


def timed(action: Any) -> float:
    begun = time.perf_counter()
    action()
    return time.perf_counter() - begun


def size_of(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def say(what: str, **values: Any) -> None:
    rounded = {k: float(f"{v:.4g}") if isinstance(v, float) else v for k, v in values.items()}
    print(json.dumps({"measured": what, **rounded}), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("scratch", type=Path)
    parser.add_argument("--vectors", type=int, nargs="+", default=[12_000, 50_000, 200_000])
    parser.add_argument("--max-size", type=int, default=400)
    parser.add_argument("--images-used", type=int, default=60)
    asked = parser.parse_args()
    files = image_files([asked.images])
    chosen = [files[i] for i in np.linspace(0, len(files) - 1, asked.images_used).astype(int)]
    some = max(1, len(chosen) // 10)
    mapped, unknown = chosen[:-some], chosen[-some:]
    for max_size in sorted({200, asked.max_size, 800, 1600}):
        entries, seconds = described(
            mapped[:: 1 if max_size == asked.max_size else 6], max_size, DEFAULTS
        )
        counts = [each.image.landmarks for each in entries]
        say(
            "image",
            max_size=max_size,
            processor_seconds=seconds,
            vectors=float(np.mean(counts)),
            keypoint_bytes=float(np.mean([sum(len(k) for _, k in e.tiles) for e in entries])),
        )
        if max_size == asked.max_size:
            real = entries
    describer, random = LandmarkDescriber(DEFAULTS), np.random.default_rng(0)
    queries = []
    for file in unknown[:PER_QUERY]:
        seen = describer.of_query(read_image(file).pixels)
        drawn = np.sort(random.permutation(len(seen))[:QUERY_VECTORS])
        queries.append(seen[drawn])
    costs = []
    for vectors in asked.vectors:
        folder = asked.scratch / f"map-{vectors}"
        try:
            costs.append(measured(folder, real, queries, vectors, DEFAULTS))
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        say("map", **vars(costs[-1]), query_vectors=QUERY_VECTORS)
    for larger in costs[2:]:
        told = extrapolated(costs[:2], larger.images, larger.vectors)
        ratios = {name: told[name] / getattr(larger, name) for name in EXTRAPOLATED}
        say("as the two smallest maps tell it, over as measured", vectors=larger.vectors, **ratios)
    per_image = costs[-1].vectors / costs[-1].images
    for images in (MILLION * 100 / per_image, float(MILLION)):
        say("extrapolated", **extrapolated(costs, images, images * per_image))


if __name__ == "__main__":
    main()
