"""Pictures of matches: the far and the near image side by side, joined by lines."""

import numpy as np
from numpy.typing import NDArray

from nearfar.arrays import Boxes, Coordinates, Mask, Matrix3, RGBPixels
from nearfar.geometry.epipolar import RelativePose
from nearfar.geometry.homography import transform
from nearfar.imaging.image import ImagePair
from nearfar.imaging.overlap import box_overlap, outer_edges
from nearfar.landmarks import LandmarkMatches, centres
from nearfar.localization import Localization
from nearfar.render.draw import (
    AGREEING,
    CATEGORIES,
    OTHER,
    WHITE,
    Colour,
    dots,
    faded,
    polygon,
    segments,
    spread,
)
from nearfar.render.page import Caption, Entry, Panel, composed, far_and_near

_MOST_LANDMARKS = 25
_MOST_OTHER_LANDMARKS = 6
_MOST_LINES, _MOST_OTHER_LINES = 120, 40
_MOST_EPIPOLAR_LINES = 7
_SAME_BOX = 0.5
"""Intersection over union above which boxes are shown once."""

_GREY: Colour = (190, 196, 206)


def point_matches(localization: Localization, images: ImagePair) -> RGBPixels:
    """Draw matched points: those that agree with the model, over a faint few of the others."""
    points = localization.points
    inliers = points.inliers
    panels = far_and_near(images.far, images.near)
    far, near = panels[0].on_page(points.far), panels[1].on_page(points.near)
    drawn = _pick(near, inliers, _MOST_LINES)
    others = _pick(near, ~inliers, _MOST_OTHER_LINES if inliers.any() else _MOST_LINES)
    page = composed(panels, _points_caption(localization, int(drawn.sum()), int(others.sum())))
    with faded(page, 0.4 if inliers.any() else 0.7) as layer:
        segments(layer, far[others], near[others], OTHER)
        for xy in (far, near):
            dots(layer, xy[others], OTHER, 2)
    with faded(page, 0.75) as layer:
        segments(layer, far[drawn], near[drawn], AGREEING)
    for xy in (far, near):
        dots(page, xy[inliers], AGREEING, 2)
    return page


def _pick(near: Coordinates, among: Mask, most: int) -> Mask:
    """Choose at most `most` of some matches, evenly spread over the near image."""
    chosen = np.zeros(len(near), np.bool_)
    index = np.flatnonzero(among)
    chosen[index[spread(near[index], most)]] = True
    return chosen


def _points_caption(localization: Localization, drawn: int, others: int) -> Caption:
    total = len(localization.points)
    agree = int(localization.points.inliers.sum())
    if not localization.localized:
        text = f"{total:,} point matches, {_shown(others, total)}" if total else "no point matches"
        entry = Entry(text, OTHER if total else None)
        return Caption(f"Not localized: {localization.reason}", (entry,))
    return Caption(
        f"{agree:,} of {total:,} point matches agree on the {_model_name(localization)}",
        (
            Entry(f"agree: {agree:,}, {_shown(drawn, agree, 'joined by lines')}", AGREEING),
            Entry(f"do not: {total - agree:,}, {_shown(others, total - agree)}", OTHER),
        ),
    )


def _shown(drawn: int, total: int, how: str = "shown") -> str:
    return f"{'all' if drawn == total else drawn} {how}"


def _model_name(localization: Localization) -> str:
    return "fundamental matrix" if localization.model == "fundamental" else localization.model


def landmark_matches(localization: Localization, images: ImagePair) -> RGBPixels:
    """Draw the most similar landmark matches, first those that agree with the model."""
    matches = localization.landmarks
    agree = agreeing_landmarks(localization)
    by_similarity = np.argsort(-matches.similarity, kind="stable")
    if agree is None:
        drawn = _distinct(matches, by_similarity, _MOST_LANDMARKS)
        others = np.empty(0, np.intp)
    else:
        drawn = _distinct(matches, by_similarity[agree[by_similarity]], _MOST_LANDMARKS)
        rest = by_similarity[~agree[by_similarity]]
        others = _distinct(matches, rest, min(_MOST_OTHER_LANDMARKS, _MOST_LANDMARKS - len(drawn)))
    panels = far_and_near(images.far, images.near)
    with faded(panels[0].pixels, 0.6) as far, faded(panels[1].pixels, 0.6) as near:
        _draw_boxes(panels[0], far, matches.far_boxes[others], None)
        _draw_boxes(panels[1], near, matches.near_boxes[others], None)
    _draw_boxes(panels[0], panels[0].pixels, matches.far_boxes[drawn], CATEGORIES)
    _draw_boxes(panels[1], panels[1].pixels, matches.near_boxes[drawn], CATEGORIES)
    page = composed(panels, _landmarks_caption(localization, agree, len(drawn), len(others)))
    _join(page, panels, matches, others, None)
    _join(page, panels, matches, drawn, CATEGORIES)
    return page


def _distinct(matches: LandmarkMatches, order: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Choose the first matches whose boxes differ, in one image at least, from those before."""
    far_edges, near_edges = outer_edges(matches.far_boxes), outer_edges(matches.near_boxes)
    chosen: list[int] = []
    for i in order:
        if len(chosen) >= most:
            break
        far = box_overlap(far_edges[[i]], far_edges[chosen])
        near = box_overlap(near_edges[[i]], near_edges[chosen])
        if not ((far > _SAME_BOX) & (near > _SAME_BOX)).any():
            chosen.append(int(i))
    return np.array(chosen, np.intp)


def _draw_boxes(
    panel: Panel, pixels: RGBPixels, boxes: Boxes, colours: tuple[Colour, ...] | None
) -> None:
    for i, corners in enumerate(box_corners(boxes)):
        polygon(pixels, panel.on_panel(corners), _colour(i, colours), 1 if colours is None else 2)


def _join(
    page: RGBPixels,
    panels: tuple[Panel, Panel],
    matches: LandmarkMatches,
    index: NDArray[np.intp],
    colours: tuple[Colour, ...] | None,
) -> None:
    """Draw lines between the centres of matched boxes."""
    far = panels[0].on_page(centres(matches.far_boxes[index]))
    near = panels[1].on_page(centres(matches.near_boxes[index]))
    thickness = 1 if colours is None else 2
    with faded(page, 0.6 if colours is None else 0.85) as layer:
        for i in range(len(index)):
            segments(layer, far[i : i + 1], near[i : i + 1], _colour(i, colours), thickness)


def _colour(i: int, colours: tuple[Colour, ...] | None) -> Colour:
    return _GREY if colours is None else colours[i % len(colours)]


def _landmarks_caption(
    localization: Localization, agree: Mask | None, drawn: int, others: int
) -> Caption:
    total = len(localization.landmarks)
    if agree is None:
        shown = Entry(f"the {drawn} most similar are shown") if drawn else Entry("none to show")
        reason = "" if localization.localized else f"   Not localized: {localization.reason}"
        return Caption(f"{total:,} landmark matches{reason}", (shown,))
    model = _model_name(localization)
    entries = [Entry(f"in colour: {drawn} that agree, of those that overlap one each")]
    if others:
        entries.append(Entry(f"the {others} most similar that do not", _GREY))
    return Caption(
        f"{agree.sum():,} of {total:,} landmark matches agree with the {model}", tuple(entries)
    )


def epipolar_matches(localization: Localization, images: ImagePair) -> RGBPixels | None:
    """Draw a few matched points and their epipolar lines; None without a fundamental matrix."""
    model, points = localization.far_from_near, localization.points
    if not isinstance(model, np.ndarray) or localization.model != "fundamental":
        return None
    panels = far_and_near(images.far, images.near)
    chosen = _pick(panels[1].on_page(points.near), points.inliers, _MOST_EPIPOLAR_LINES)
    far, near = points.far[chosen], points.near[chosen]
    _draw_epipolar(panels[0], far, epipolar_lines(model, near))
    _draw_epipolar(panels[1], near, epipolar_lines(model.T, far))
    return composed(
        panels,
        Caption(
            "Each point lies on the epipolar line of the point it is matched with",
            (Entry(f"{len(far)} of {points.inliers.sum():,} matches that agree"),),
        ),
    )


def _draw_epipolar(panel: Panel, xy: Coordinates, lines: NDArray[np.floating]) -> None:
    """Draw points of one image and the (N, 3) epipolar lines of the points matched with them."""
    lines = lines @ np.linalg.inv(panel.panel_from_original)
    middle = np.array([panel.width, panel.height]) / 2
    reach = float(np.linalg.norm(middle)) + 2
    for i, (line, point) in enumerate(zip(lines, panel.on_panel(xy), strict=True)):
        length = np.linalg.norm(line[:2])
        if length == 0:
            continue
        normal = line[:2] / length
        distance = normal @ middle + line[2] / length
        if abs(distance) > reach:
            continue
        along = np.array([-normal[1], normal[0]]) * reach
        foot = middle - distance * normal
        ends = np.stack([foot - along, foot + along])
        polygon(panel.pixels, ends, CATEGORIES[i % len(CATEGORIES)], 1)
        dots(panel.pixels, point[np.newaxis], WHITE, 4.5)
        dots(panel.pixels, point[np.newaxis], CATEGORIES[i % len(CATEGORIES)], 3.5)


_CENTRE_TOLERANCE = 0.35
"""Largest distance of two centres, as a share of the box's diagonal."""

_SIZE_TOLERANCE = 1.7
"""Largest factor between the lengths of two boxes."""


def agreeing_landmarks(localization: Localization) -> Mask | None:
    """Return an (M,) mask of matches whose boxes agree with the model; None for other models.

    A homography must map the near box to about the place and size of the far one; the epipolar
    line of the near box's centre must cross the far box near its centre. A pose cannot tell,
    since a localization holds no intrinsics.
    """
    model, matches = localization.far_from_near, localization.landmarks
    if model is None or isinstance(model, RelativePose) or len(matches) == 0:
        return None
    distance = (
        _homography_distance(model, matches)
        if localization.model == "homography"
        else _epipolar_distance(model, matches)
    )
    mask: Mask = distance <= _CENTRE_TOLERANCE * np.hypot(*matches.far_boxes[:, 2:].T)
    return mask


def _homography_distance(model: Matrix3, matches: LandmarkMatches) -> NDArray[np.floating]:
    """Return (M,) distances of far centres from mapped near ones, infinite if sizes differ."""
    corners = transform(model, box_corners(matches.near_boxes).reshape(-1, 2)).reshape(-1, 4, 2)
    area = matches.far_boxes[:, 2:].prod(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.sqrt(quadrangle_area(corners) / area)
        distance = np.linalg.norm(
            transform(model, centres(matches.near_boxes)) - centres(matches.far_boxes), axis=1
        )
        alike = (factor < _SIZE_TOLERANCE) & (factor > 1 / _SIZE_TOLERANCE)
    return np.where(alike, distance, np.inf)


def _epipolar_distance(model: Matrix3, matches: LandmarkMatches) -> NDArray[np.floating]:
    """Return (M,) distances of far centres from the epipolar lines of near ones, in pixels."""
    lines = epipolar_lines(model, centres(matches.near_boxes))
    far = centres(matches.far_boxes)
    with np.errstate(invalid="ignore", divide="ignore"):
        distance = np.abs((lines[:, :2] * far).sum(axis=1) + lines[:, 2])
        return np.asarray(distance / np.linalg.norm(lines[:, :2], axis=1))


def epipolar_lines(model: Matrix3, xy: Coordinates) -> NDArray[np.floating]:
    """Return the (N, 3) lines a x + b y + c = 0 in one image of (N, 2) points of the other."""
    return np.asarray(np.column_stack([xy, np.ones(len(xy))]) @ model.T)


def box_corners(boxes: Boxes) -> NDArray[np.floating]:
    """Return the (N, 4, 2) outer corners of (N, 4) boxes, in order round each."""
    left, top = boxes[:, 0] - 0.5, boxes[:, 1] - 0.5
    right, bottom = left + boxes[:, 2], top + boxes[:, 3]
    x = np.stack([left, right, right, left], axis=1)
    y = np.stack([top, top, bottom, bottom], axis=1)
    return np.stack([x, y], axis=2)


def quadrangle_area(corners: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the (N,) areas of (N, 4, 2) quadrangles, from their diagonals."""
    first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return np.asarray(np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2)
