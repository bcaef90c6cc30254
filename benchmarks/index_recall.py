"""How many of the nearest landmarks the index of a map finds, and how long it takes.

    python benchmarks/index_recall.py MAP IMAGE [IMAGE ...] [--each 64]

So many descriptors are drawn from each image, and compared with all landmarks of the map. One row a
number of landmarks that are compared exactly, and of landmarks of the map per partition probed.
"""

import argparse
import time
from itertools import product
from pathlib import Path

import numpy as np

from map_scale import shared
from nearfar.bench.tables import markdown
from nearfar.imaging.image import read_image
from nearfar.maps import DEFAULTS, store
from nearfar.maps.landmarks import LandmarkDescriber
from nearfar.maps.search import nearest, nearest_by_index
from nearfar.maps.store import MapStore

COMPARED, LANDMARKS_PER_PROBE = (80, 160, 320), (50_000, 25_000)
COUNT = 10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("images", type=Path, nargs="+")
    parser.add_argument("--each", type=int, default=64, help="descriptors of each image")
    asked = parser.parse_args()
    describer, random, drawn = LandmarkDescriber(DEFAULTS), np.random.default_rng(0), []
    for image in asked.images:
        vectors = describer.of_query(read_image(image).pixels).vectors
        drawn.append(vectors[np.sort(random.permutation(len(vectors))[: asked.each])])
    vectors, opened = np.vstack(drawn), MapStore(asked.map)
    known = {image.id for image in opened.images()}
    exact = nearest(opened.blocks(), vectors, COUNT, known)
    rows = []
    for store.LANDMARKS_PER_PROBE, store.COMPARED in product(LANDMARKS_PER_PROBE, COMPARED):
        nearest_by_index(opened, vectors[:32], COUNT, known)  # Fills the caches.
        begun = time.perf_counter()
        quick = nearest_by_index(opened, vectors, COUNT, known)
        seconds = time.perf_counter() - begun
        settings = f"{store.LANDMARKS_PER_PROBE:,}", str(store.COMPARED)
        rows.append([*settings, f"{shared(exact, quick):.3f}", f"{seconds:.2f}"])
    print(f"{len(vectors)} descriptors, {opened.landmark_count():,} landmarks\n")
    print(markdown(["landmarks per partition", "compared", f"recall@{COUNT}", "seconds"], rows))


if __name__ == "__main__":
    main()
