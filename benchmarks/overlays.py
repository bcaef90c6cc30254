"""Count answers that a shared overlay gives, and true places that are lost under it.

    python benchmarks/overlays.py PHOTOS --out overlays.jsonl [--pairs 60] [--max-effort points]

Two unrelated photographs of PHOTOS get the same overlay, as do a photograph and a close-up of it,
which are also localized without. Photographs whose names agree up to the first underscore may show
one place, and make no unrelated pair. The table counts, for each kind of overlay, unrelated pairs
with a confidence of 0.5 or more, true pairs within 3 pixels without it, and those of them within 3
pixels with it. Rows are appended; pairs that are there are skipped.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nearfar import Localizer
from nearfar.arrays import Matrix3, RGBPixels
from nearfar.geometry.homography import outline, scaling, transform, translation
from nearfar.imaging.image import read_image

SIZE = (960, 720)
"""Width and height of every picture, in pixels."""
CLOSE_UP, LARGER = (300, 225), 3.2
"""Width and height of the part that a close-up shows, and how much larger."""

Overlay = Callable[[RGBPixels], None]


def write(out: RGBPixels, text: str, at: tuple[int, int], size: float, colour: int) -> None:
    """Draw a line of text, with its lower left corner at a point."""
    cv2.putText(out, text, at, 0, size, (colour,) * 3, 1 + (size > 0.7), cv2.LINE_AA)


def data_bar(out: RGBPixels) -> None:
    """Draw the bar of an electron microscope."""
    out[-70:] = 10
    write(out, "HV 15.0 kV  WD 9.8 mm  mag 5 000x  det SE  HFW 55 um", (12, 690), 0.8, 240)
    cv2.line(out, (760, 705), (900, 705), (240, 240, 240), 3)


def app_frame(out: RGBPixels) -> None:
    """Draw the frame of an app above and below."""
    out[:110] = out[-150:] = 250
    for row, text in enumerate(("12:45  LTE  87 %", "Photos  Albums  Search", "Share  Edit  Info")):
        for y in (30 + 32 * row, 600 + 34 * row):
            write(out, text, (20 + 170 * row, y), 0.8, 30)


def head_up_display(out: RGBPixels) -> None:
    """Draw the display of a drone."""
    write(out, "H 120.4 m  D 88.1 m", (20, 40), 0.8, 255)
    write(out, "ISO 100 1/800 F2.8", (20, 700), 0.8, 255)
    write(out, "N60.40324 E22.46213", (620, 40), 0.8, 255)
    write(out, "BAT 71 % SAT 17", (660, 700), 0.8, 255)
    cv2.circle(out, (480, 360), 60, (0, 255, 0), 2, cv2.LINE_AA)
    cv2.drawMarker(out, (480, 360), (0, 255, 0), cv2.MARKER_CROSS, 160, 2)


def watermark(out: RGBPixels) -> None:
    """Draw half-transparent text in tiles."""
    ink = np.zeros(out.shape[:2], np.uint8)
    for y in range(60, 720, 110):
        for x in range(-60 * (y % 3), 960, 330):
            cv2.putText(ink, "SAMPLE (c)", (x, y), 0, 1.4, 255, 2, cv2.LINE_AA)
    share = 0.5 * ink[..., np.newaxis] / 255
    out[:] = out * (1 - share) + 255 * share


def letterbox(out: RGBPixels) -> None:
    """Draw black bars, with a channel's logo and a ticker."""
    out[:80] = out[-80:] = 0
    write(out, "LIVE", (860, 60), 1.0, 255)
    write(out, "BREAKING: second storm expected on the coast by noon", (20, 690), 0.8, 255)


def time_stamp(out: RGBPixels) -> None:
    """Draw the line of a trail camera."""
    out[-44:] = 20
    write(out, "TRAILCAM 04  2024-05-17 06:41:09  11 C  980 hPa", (14, 708), 0.9, 255)


def map_legend(out: RGBPixels) -> None:
    """Draw the legend and the scale of a map sheet."""
    out[500:700, 20:320] = 255
    for row, text in enumerate(("Legend", "road", "river", "forest", "border", "1 : 25 000")):
        write(out, text, (70, 530 + 32 * row), 0.7, 0)
        cv2.rectangle(out, (34, 516 + 32 * row), (58, 532 + 32 * row), (40 * row, 200, 90), -1)


def logo(out: RGBPixels) -> None:
    """Draw a logo in a corner."""
    cv2.circle(out, (880, 80), 52, (255, 255, 255), -1)
    cv2.circle(out, (880, 80), 44, (180, 20, 40), -1)
    write(out, "SURVEY", (836, 88), 0.7, 255)


def scale_card(out: RGBPixels) -> None:
    """Draw a photographer's scale card with a ruler."""
    out[600:690, 60:520] = 240
    for index in range(21):
        height = 34 if index % 5 == 0 else 18
        cv2.line(out, (80 + 20 * index, 600), (80 + 20 * index, 600 + height), (0, 0, 0), 2)
    write(out, "10 cm   site 4 / layer B", (90, 672), 0.8, 0)


def reticle(out: RGBPixels) -> None:
    """Draw the graduated cross of a telescope or a level."""
    cv2.line(out, (0, 360), (959, 360), (20, 20, 20), 1)
    cv2.line(out, (480, 0), (480, 719), (20, 20, 20), 1)
    for step in range(-9, 10):
        cv2.line(out, (480 + 48 * step, 352), (480 + 48 * step, 368), (20, 20, 20), 1)
        cv2.line(out, (472, 360 + 36 * step), (488, 360 + 36 * step), (20, 20, 20), 1)
    write(out, "x 32", (500, 350), 0.6, 20)


def subtitles(out: RGBPixels) -> None:
    """Draw two lines of subtitles with dark outlines."""
    for row, text in enumerate(("The harbour was already closed", "when the second ship arrived.")):
        for width, colour in ((5, 0), (2, 255)):
            at = (220, 630 + 44 * row)
            cv2.putText(out, text, at, 0, 1.1, (colour,) * 3, width, cv2.LINE_AA)


def border(out: RGBPixels) -> None:
    """Draw the printed border of a slide or a postcard."""
    out[:60] = out[-90:] = out[:, :50] = out[:, -50:] = 235
    cv2.rectangle(out, (50, 60), (909, 629), (90, 70, 40), 3)
    write(out, "Greetings from the coast  -  No. 1147  -  printed in 1962", (70, 690), 0.8, 60)


KINDS: list[Overlay] = [
    data_bar, app_frame, head_up_display, watermark, letterbox, time_stamp, map_legend, logo,
    scale_card, reticle, subtitles, border,
]  # fmt: skip


def picture(file: Path) -> RGBPixels:
    """Return a photograph at the size of all pictures."""
    return np.asarray(cv2.resize(read_image(file).pixels, SIZE, interpolation=cv2.INTER_AREA))


def close_up(far: RGBPixels, rng: np.random.Generator) -> tuple[RGBPixels, Matrix3]:
    """Return a part of a picture enlarged to the same size, and the homography to the picture."""
    width, height = CLOSE_UP
    x = int(rng.integers(130, SIZE[0] - width - 130))
    y = int(rng.integers(130, SIZE[1] - height - 170))
    part = far[y : y + height, x : x + width]
    near = cv2.resize(part, SIZE, interpolation=cv2.INTER_CUBIC)
    noisy = np.clip(near + rng.normal(0, 3, near.shape), 0, 255).astype(np.uint8)
    return noisy, translation(x, y) @ scaling(1 / LARGER, 1 / LARGER)


def overlaid(pixels: RGBPixels, kind: Overlay) -> RGBPixels:
    """Return a copy of a picture with an overlay."""
    out = pixels.copy()
    kind(out)
    return out


def error(found: Any, truth: Matrix3) -> float | None:
    """Return the mean error of the corners in far pixels; None where nothing was found."""
    if found.far_from_near is None:
        return None
    corners = outline(*SIZE)
    away = transform(found.far_from_near, corners) - transform(truth, corners)
    return float(np.linalg.norm(away, axis=1).mean())


def measured(photos: list[Path], index: int, localizer: Localizer) -> dict[str, Any]:
    """Localize one unrelated and one true pair under one overlay."""
    rng = np.random.default_rng(index)
    kind = KINDS[index % len(KINDS)]
    one = photos[rng.integers(len(photos))]
    others = [each for each in photos if each.name.split("_")[0] != one.name.split("_")[0]]
    far, unrelated = picture(one), picture(others[rng.integers(len(others))])
    near, truth = close_up(far, rng)
    wrong = localizer.localize(overlaid(far, kind), overlaid(unrelated, kind))
    plain = localizer.localize(far, near)
    marked = localizer.localize(overlaid(far, kind), overlaid(near, kind))
    return {
        "pair": index,
        "kind": kind.__name__,
        "unrelated": wrong.confidence if wrong.localized else 0.0,
        "without": error(plain, truth),
        "with": error(marked, truth),
    }


def show(rows: Sequence[dict[str, Any]]) -> None:
    """Print the table of rows."""
    print("| overlay | unrelated | of | true, without | true, with |\n|---|---|---|---|---|")
    for name in [*(kind.__name__ for kind in KINDS), "all"]:
        own = [row for row in rows if name in (row["kind"], "all")]
        wrong = sum(row["unrelated"] >= 0.5 for row in own)
        found = [row for row in own if row["without"] is not None and row["without"] < 3]
        kept = sum(row["with"] is not None and row["with"] < 3 for row in found)
        print(f"| {name.replace('_', ' ')} | {wrong} | {len(own)} | {len(found)} | {kept} |")


def main() -> None:
    """Localize all pairs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--pairs", type=int, default=60)
    parser.add_argument("--max-effort", default="points")
    options = parser.parse_args()
    photos = sorted(each for each in options.photos.rglob("*") if each.suffix in (".jpg", ".png"))
    lines = options.out.read_text().splitlines() if options.out.exists() else []
    rows = [json.loads(line) for line in lines]
    localizer = Localizer(max_effort=options.max_effort)
    for index in range(len(rows), options.pairs):
        rows.append(measured(photos, index, localizer))
        with options.out.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    show(rows)


if __name__ == "__main__":
    main()
