"""The constants of each step: what its behaviour hangs on and no user has reason to change.

A value without a measurement in its text was set once and never varied.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, field, fields
from typing import Any

DIGEST_OF_0_1_0 = "5a637cb32cdb"
"""Hash of the other constants, which are those of version 0.1.0 and are not recorded."""
ADDED = (
    "search", "zoom", "alignment", "views", "refinement", "agreement", "overlay", "form",
    "ambiguity", "candidates", "learned", "uncertainty", "plane",
)  # fmt: skip
"""Steps that version 0.1.0 did not have, or had with other constants."""


@dataclass(frozen=True, kw_only=True)
class PointConstants:
    """First step of the adaptive method: SIFT keypoints all over both images."""

    contrast: float = field(default=0.02, metadata={"features": True})
    """SIFT's contrast threshold: best of a grid on the development data, as in `sift-tuned`."""
    ratio: float = 0.9
    """Ratio test: best of the same grid."""
    inlier_threshold: float = 1.0
    """Largest error of an inlier, in pixels; best of the same grid. The tuned methods use it."""
    pyramid_bytes: int = 300_000_000
    """Memory for the pyramids of the latest far images; one may take six times its image's."""


@dataclass(frozen=True, kw_only=True)
class LadderConstants:
    """When the adaptive method stops, and how many hypotheses of each source it tries.

    Significance is the decimal logarithm of the number of false alarms: less is better.
    """

    sufficient_homography: float = -20.0
    """Significance of a homography at which no further step is tried."""
    sufficient_epipolar: float = -30.0
    """Significance of a fundamental matrix or a pose at which no further step is tried."""
    from_votes: int = 10
    """Hypotheses from votes that are tried."""
    votes_before_search: int = 2
    """Hypotheses from votes that are tried before the landmark search."""
    from_search: int = 10
    """Hypotheses from each landmark search that are tried as they are."""
    aligned: int = 100
    """Hypotheses from each landmark search that are aligned where no earlier one was accepted."""
    from_alignment: int = 20
    """Aligned hypotheses that are tried."""
    promising: float = 3.0
    """Significance below which a model is worth a second, narrower guided matching."""
    refined: float = -2.0
    """Significance up to which the best homography is refined."""


@dataclass(frozen=True, kw_only=True)
class RefinementConstants:
    """Refinement of homographies that the first step found with few matches."""

    sure: float = -60.0
    """Significance that is good enough without it. Of 36 homographies of made pairs with 10 to 38
    inliers 4 were off by 3 to 11 pixels, and none by more than 2 when they were refined."""


@dataclass(frozen=True, kw_only=True)
class EpipolarConstants:
    """Fitting of fundamental matrices and poses to the matches of all hypotheses together."""

    lax_ratio: float = 0.97
    """Ratio test of matches that are ordered by their neighbours' support."""
    local_threshold: float = 3.0
    """Largest error of an inlier of a hypothesis' own homography, in pixels."""
    local_significance: float = -2.0
    """Significance of that homography below which the hypothesis' matches are added."""
    most_ordered: int = 400
    """Matches with most support that a model is fitted to."""


@dataclass(frozen=True, kw_only=True)
class VoteConstants:
    """Votes: similarity transforms on which matches agree."""

    most_matches: int = 3000
    """Most distinctive matches that vote."""
    least_weight: float = 0.08
    """Least weight of a match: 1 minus the squared ratio of its two nearest distances."""
    seeds: int = 300
    """Most distinctive matches that propose transforms."""
    scale_tolerance: float = 1.6
    """Factor by which the scales of agreeing matches may differ."""
    angle_tolerance: float = 30.0
    """Angle by which the rotations of agreeing matches may differ, in degrees."""
    least_tolerance: float = 8.0
    """Far pixels by which agreeing matches may disagree where they are close together."""
    distance_tolerance: float = 0.25
    """Share of the distance of two matches that is added to that."""
    least_supporters: int = 3
    """Matches that a hypothesis needs."""
    cell: float = 3.0
    """Side of a cell, in pixels, in which matches count once."""
    neighbourhood: float = 150.0
    """Near pixels within which matches support each other in a scene with depth."""


@dataclass(frozen=True, kw_only=True)
class SearchConstants:
    """Landmark search: the near image as a template in a feature pyramid of the far image."""

    template_side: int = 96
    """Longest side of the reduced near image, in pixels."""
    dimensions: int = 64
    """Principal components kept of the features."""
    most_cells: int = 2000
    """Cells from which principal components are computed; at most twice as many are taken."""
    turns: int = 16
    """Rotations of the template, evenly spread."""
    largest_scale: float = 1.6
    """Scale of the largest pyramid level."""
    smallest_scale: float = 0.1
    """Scale that the smallest pyramid level does not go below."""
    levels_per_octave: int = 3
    """Pyramid levels from one scale to half of it."""
    most_pixels: int = 3_000_000
    """Largest number of pixels of a pyramid level."""
    largest_enlarged: float = 3.2
    """Scale of the largest upsampled level, for places a few dozen pixels large."""
    enlarged_per_octave: int = 2
    """Upsampled levels from one scale to half of it; the most expensive ones."""
    most_enlarged_pixels: int = 12_000_000
    """Largest number of pixels of an upsampled pyramid level."""
    peak_distance: float = 0.25
    """Distance, as a share of the template's diagonal, below which two peaks are one..."""
    peak_scale: float = 1.5
    """...if their scales differ by less than this factor..."""
    peak_angle: float = 30.0
    """...and their rotations by less than this angle, in degrees."""


@dataclass(frozen=True, kw_only=True)
class ZoomConstants:
    """Zoom: guided matching in the region that a hypothesis gives, at one scale."""

    contrast: float = 0.01
    """SIFT's contrast threshold."""
    ratio: float = 0.9
    """Ratio test among the keypoints within reach."""
    most_points: int = 2000
    """Keypoints of a frame, those of the highest contrast."""
    size_tolerance: float = 1.7
    """Factor by which the sizes of matched keypoints may differ."""
    angle_tolerance: float = 40.0
    """Angle by which their orientations may differ, in degrees."""
    reach: float = 0.12
    """Distance from the expected position within which a match may lie, as a share of the frame's
    diagonal, for a hypothesis..."""
    second_reach: float = 0.05
    """...for the model found with it..."""
    refinements: tuple[float, ...] = (0.03, 0.01)
    """...and for the refinements of the best homography."""
    least_reach: float = 4.0
    """Least such distance, in pixels of the frame."""
    longest_side: float = 640.0
    """Longest side of a frame, in pixels."""
    most_enlarged: float = 4.0
    """Largest factor by which the far image is enlarged."""
    margin: float = 0.15
    """Far pixels around the expected region, as a share of its longest side."""
    least_side: int = 8
    """Shorter side of a region below which it is not compared, in far pixels."""
    preview_side: float = 320.0
    """Longest side of the frame of a preview, in pixels."""
    least_preview: float = 1.25
    """Longest side of the full frame above which there is a preview, in frames of a preview."""
    preview_points: int = 1000
    """Keypoints of a preview, those of the highest contrast."""
    least_preview_points: int = 40
    """Keypoints of the near image below which a preview tells nothing: a hazy photograph from the
    air has 1 to 30."""
    preview_scales: int = 3
    """Scales from one to half of it at which the keypoints of the near image are detected."""
    clear_preview: float = -6.0
    """Significance of a preview below which the hypothesis is zoomed in on at once. In 18 pairs
    that late steps decide, or none, wrong places have 0.6 or more. Correct ones have -23 or less,
    and in three pairs of EVD 0 to -3."""
    least_clear_preview: float = 3.0
    """Significance of a preview above which the hypothesis is not zoomed in on."""
    after_preview: int = 2
    """Hypotheses of a batch between these limits that are zoomed in on, the best ones."""


@dataclass(frozen=True, kw_only=True)
class AlignmentConstants:
    """Alignment: search hypotheses refined to affine transforms with fine features."""

    first_frame: tuple[int, float] = (128, 40.0)
    """Longest side of the near image, and the distance within which a cell is matched, both in
    pixels of the frame: the first pass over all hypotheses..."""
    wide_frame: tuple[int, float] = (192, 56.0)
    """...another pass over the best of them, from where they began..."""
    later_frames: tuple[tuple[int, float], ...] = ((160, 32.0), (192, 24.0))
    """...and the frames that refine the best of both passes, one after the other."""
    again: int = 30
    """Hypotheses with most agreement in the first pass that the wide one takes."""
    kept_first: int = 40
    """Hypotheses that the first pass keeps. A correct one was among its first 20 in each of four
    pairs that alignment decides."""
    kept_wide: int = 20
    """Hypotheses that the wide pass keeps."""
    kept_later: int = 30
    """Hypotheses that each later frame keeps."""
    least_similarity: float = 0.2
    """Cosine similarity above which two cells match."""
    least_cells: int = 6
    """Matched cells that a transform needs."""
    tolerance: float = 8.0
    """Largest error of a cell that agrees with a transform, in pixels of the frame."""
    most_rescaled: float = 2.5
    """Factor by which the scale may change against the search hypothesis."""
    most_foreshortened: float = 8.0
    """Largest ratio of the scales along the two axes of the affine transform."""
    border: int = 16
    """Pixels around the compared area that the features at its edge see."""


@dataclass(frozen=True, kw_only=True)
class ViewConstants:
    """Simulated views (ASIFT; Morel and Yu, 2009) of both images."""

    longest_sides: tuple[int, ...] = (640, 400)
    """Longest side of the images that the first and the added views are made of, in pixels. With
    480 for the first views, the pair `girl` of EVD is lost, which views decide."""
    contrast: float = 0.02
    """SIFT's contrast threshold."""
    points_per_view: tuple[int, ...] = (800, 500)
    """Keypoints of a view, those of the highest contrast."""
    ratio: float = 0.85
    """Ratio test against the next keypoint outside `fginn_radius`."""
    fginn_radius: float = 10.0
    """Keypoints closer than this, in pixels, are one keypoint seen in several views (FGINN)."""
    cell: float = 2.0
    """Side of a cell, in pixels, that gives at most one match."""


@dataclass(frozen=True, kw_only=True)
class AcceptanceConstants:
    """Acceptance: models that their inliers leave underdetermined are refused."""

    least_parallax: float = 8.0
    """Median parallax over median error from which two cameras stand apart: between turned
    cameras (about 2) and KITTI's moving ones (at least 20), see `benchmarks/parallax.py`."""
    open_share: float = 0.1
    """Standard deviation of the corners, as a share of the footprint's diagonal, up to which a
    homography is determined."""
    open_pixels: float = 3.0
    """The same in far pixels, where the share is less: the benchmarks' loose success."""
    largest_shortening: float = 30.0
    """Ratio of the scales along two directions at one point; the strongest known pair has 20."""
    largest_scale: float = 100.0
    """Factor by which a plausible homography enlarges or reduces at most."""


@dataclass(frozen=True, kw_only=True)
class AgreementConstants:
    """Agreement of the near image with the far image where a model or its matches put it."""

    least: float = 0.3
    """Share of cells that agree below which a homography is refused. Of 50 correct ones of the
    development pairs the lowest have 0.35, 0.44 and 0.47 (bare sand, a white board)."""
    least_cells: int = 20
    """Cells that both images show below which nothing is said."""
    side: int = 128
    """Longest side of the reduced near image, in pixels."""
    margin: int = 40
    """Pixels around it in which cells are compared."""
    inner: float = 2.5
    """Least distance of the cells around that a cell is ranked among, in cells of 8 pixels."""
    outer: int = 4
    """Largest such distance, in cells."""
    away: float = 24.0
    """Pixels of the frame from the nearest inlier beyond which cells are also counted alone."""
    least_away: float = 0.18
    """Share of these that agree below which a homography is refused; the lowest correct one has
    0.22..."""
    sure: float = 0.6
    """...unless so many of all cells agree."""
    least_around: int = 8
    """Cells around that the far image must show."""
    best_share: float = 0.05
    """Share of the cells around that may be more similar than the cell in its place."""
    reach: float = 0.3
    """Distance from the nearest inlier up to which epipolar geometry places a cell, as a share of
    the near image's longest side."""


@dataclass(frozen=True, kw_only=True)
class AmbiguityConstants:
    """Ambiguity: other places of the far image that the near image fits nearly as well."""

    contrast: float = 0.02
    """SIFT's contrast threshold in the near image, reduced to the scale of the far one."""
    least_factor: float = 0.7
    """Scale of the far over the near image above which the near image is not reduced."""
    most_points: int = 300
    """Keypoints of the near image, those of the highest contrast."""
    neighbours: int = 10
    """Similar far keypoints that each votes with: as many equal places are seen."""
    most_distance: float = 0.35
    """Squared distance of RootSIFT descriptors below which keypoints are similar."""
    least_own: int = 8
    """Keypoints that agree with the answer itself below which pixels are compared instead."""
    correlated_side: float = 96.0
    """Longest side of the footprint when pixels are compared, in pixels."""
    least_correlation: float = 0.4
    """Correlation of the answer's own place below which pixels say nothing."""
    least_correlated: float = 0.8
    """Correlation of an alternative, as a share of the answer's."""
    most: int = 24
    """Hypotheses that are compared, some of them at one place."""
    seeds: int = 80
    """Most similar matches that propose places."""
    least_distance: float = 0.15
    """Distance of an alternative from the answer, as a share of the footprint's diagonal."""
    least_agreement: float = 0.85
    """Agreement of an alternative, as a share of the answer's."""
    equal: float = 0.9
    """Score from which an alternative gets as large a part of the confidence as the answer: counts
    of keypoints vary by as much between equal places."""
    least_score: float = 0.6
    """Keypoints that agree with an alternative, as a share of those that agree with the answer."""


@dataclass(frozen=True, kw_only=True)
class OverlayConstants:
    """Static overlays: what both pictures share at the same place of the picture."""

    most_points: int = 200
    """About how many inliers decide which corner, border or middle is tried."""
    tolerance: float = 1.5
    """Far pixels by which a match may miss the same place of the picture."""
    least_share: float = 0.5
    """Share of the inliers at the same place from which an overlay is looked for."""
    least_agreement: float = 0.5
    """Agreement outside the common pixels from which the scene is the same."""
    least_correlated: float = 0.4
    """Share of the blocks outside the common pixels whose correlation is above 0.5, from which the
    scene is the same."""
    least_deviation: float = 3.0
    """Standard deviation of values (0..255) from which a block of either picture has texture."""
    least_blocks: int = 12
    """Textured blocks outside the common pixels below which the scene is the same."""
    least_outside: float = 0.2
    """The same as a share of all textured blocks; less may be what passes a camera that stands."""
    cell: int = 16
    """Side of the cells whose pixels are compared, in pixels."""
    most_difference: float = 6.0
    """Mean difference of a cell's values (0..255) up to which its pixels are common."""
    rounds: int = 3
    """Overlays at different places of the picture that are left out one after the other."""
    least_contrast: float = 20.0
    """Difference of a pixel from its surroundings (0..255), in both pictures, of a common line."""
    most_lines: float = 0.03
    """Share of the picture that common lines cover, above which they may be chance."""
    radius: int = 12
    """Pixels around common lines and around matches at the same place that belong to the overlay;
    a semi-transparent mark has no common pixels."""


@dataclass(frozen=True, kw_only=True)
class FormConstants:
    """Common forms: two pages with one print and different entries.

    The blocks are those of the near image at the scale of the far one.
    """

    side: int = 16
    """Side of the blocks that are compared, in pixels."""
    step: int = 8
    """Distance of their middles, in pixels."""
    shift: int = 2
    """Largest shift at which blocks are compared, in pixels."""
    flat: float = 3.0
    """Standard deviation of values (0..255) below which a block is flat."""
    textured: float = 6.0
    """Standard deviation above which it has texture."""
    equal: float = 8.0
    """Difference of the means of flat blocks below which the ground is equal."""
    least_ground: float = 0.22
    """Share of the blocks that are flat and equal from which the pictures are pages of one kind.
    Forms have 0.26 to 0.54. Of 34 true pairs of photographs one has 0.30, all others at most
    0.16."""
    least_blocks: int = 60
    """Textured blocks below which nothing is said."""
    different: float = 0.7
    """Correlation below which textured blocks differ."""
    same: float = 0.9
    """Correlation above which they are the same."""
    least_different: float = 0.06
    """Share of the textured blocks that differ from which the entries do. Forms have 0.09 to 0.25,
    true pairs with an equal ground at most 0.01."""
    least_same: float = 0.3
    """Share of the textured blocks that are the same from which the print is common."""


@dataclass(frozen=True, kw_only=True)
class CandidateConstants:
    """Candidates: places that are told where nothing was accepted."""

    most: int = 5
    """Candidates that are told."""
    compared: int = 4
    """Places of each source (fitted, proposed, sought) that are compared."""
    least_agreement: float = 0.8
    """Agreement of the best candidate from which it is the place under another appearance. The
    alignment, which looks for agreement, has reached 0.65 at wrong places."""
    small: float = 32.0
    """Longer side of such a place in far pixels below which it is too small to be found."""


@dataclass(frozen=True, kw_only=True)
class LearnedConstants:
    """Learned matchers, alone and as a step of the adaptive method."""

    longest_side: int = 1024
    """Longest side of the image that a network sees, in pixels; ALIKED and LightGlue were trained
    near this size."""
    least_side: int = 32
    """Shorter side of an image below which it has no learned points, in pixels."""
    most_points: int = 2048
    """Points of an image, those of the highest score."""
    least_cosine: float = 0.82
    """Cosine of two XFeat descriptors above which they match, as published."""
    least_score: float = 0.02
    """Score of an ALIKED point. The published 0.2 finds 800 points instead of 2048 in a hazy aerial
    photograph, and 18 instead of 249 matches that agree on a homography."""
    threshold: float = 3.0
    """Largest error of an inlier, in pixels: learned points are less exact than SIFT's."""
    from_others: int = 3
    """Hypotheses from votes and search whose regions are matched, and that tell rotations."""
    turns: int = 4
    """Quarter turns of the near image in which whole images are matched, the likeliest first."""
    promising: float = -2.0
    """Significance of a homography of whole images from which its region is matched."""
    least_agreement: float = 0.5
    """Share of cells that agree with a homography of the second matcher below which its model
    counts as none. SIFT's limit is 0.3. Of 64 fits to XFeat's matches of 32 unrelated pairs, 11
    had a significance below -2 and 4 below -20; their agreement was at most 0.43."""
    least_agreement_in_depth: float = 0.3
    """The same for the homography of most matches where the model is another: in a scene with
    depth it holds for one surface alone..."""
    significance_in_depth: float = -60.0
    """...and the significance that such a model needs; the strongest of those 64 fits has -21."""
    sure_in_depth: float = -250.0
    """Significance of a fundamental matrix by SIFT's matches above which the matcher adds its own:
    few matches are at the right place, but determine it badly."""


@dataclass(frozen=True, kw_only=True)
class PlaneConstants:
    """Planes: epipolar geometries that matches beside one plane do not determine."""

    least_matches: int = 8
    """Inliers below which no plane is looked for."""
    tolerance: float = 3.0
    """Largest error of a match on the plane, in thresholds of an inlier: planes are uneven."""
    least_share: float = 0.5
    """Share of the inliers on the plane from which the matches beside it must be significant."""
    least_angle: float = 5.0
    """Angle in degrees between the directions of two poses that count as different."""
    least_agreement: float = 0.95
    """Share of the inliers that the other pose of a plane agrees with, if it fits as well."""


@dataclass(frozen=True, kw_only=True)
class UncertaintyConstants:
    """Expected error: what noise, misfit and the place of the inliers leave open."""

    noise: float = 0.3
    """Usual standard deviation of a coordinate of an inlier, in far pixels of the working image."""
    noise_weight: float = 3.0
    """How many coordinates this weighs as much as, beside those of the inliers."""
    least: float = 0.02
    """Expected error that many exact matches do not fall below, in the same pixels."""
    cell: float = 2.0
    """Side of a cell, in the same pixels, in which matches count once: their errors are common."""
    pose_cell: float = 60.0
    """The same for poses, which leave room for errors of the calibration that change slowly over
    the image. Chosen on KITTI 03, where the rotation is then off as far as expected."""
    most_points: int = 1500
    """Inliers that are used, evenly thinned."""
    side: int = 7
    """Rows and columns of the places of the near image at which the error is expected."""
    misfits: tuple[float, ...] = (1e-6, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
    """Sizes that a smooth misfit may have, by a bent lens or by depth, as shares of half the
    footprint's diagonal..."""
    misfit_odds: tuple[float, ...] = (0.3, 0.15, 0.15, 0.12, 0.1, 0.08, 0.06, 0.04)
    """...and how probable each is before the inliers are looked at."""


@dataclass(frozen=True, kw_only=True)
class Constants:
    """The constants of all steps."""

    points: PointConstants = PointConstants()
    ladder: LadderConstants = LadderConstants()
    refinement: RefinementConstants = RefinementConstants()
    epipolar: EpipolarConstants = EpipolarConstants()
    votes: VoteConstants = VoteConstants()
    search: SearchConstants = SearchConstants()
    zoom: ZoomConstants = ZoomConstants()
    alignment: AlignmentConstants = AlignmentConstants()
    views: ViewConstants = ViewConstants()
    acceptance: AcceptanceConstants = AcceptanceConstants()
    agreement: AgreementConstants = AgreementConstants()
    overlay: OverlayConstants = OverlayConstants()
    form: FormConstants = FormConstants()
    ambiguity: AmbiguityConstants = AmbiguityConstants()
    candidates: CandidateConstants = CandidateConstants()
    learned: LearnedConstants = LearnedConstants()
    uncertainty: UncertaintyConstants = UncertaintyConstants()
    plane: PlaneConstants = PlaneConstants()

    def for_features(self) -> dict[str, Any]:
        """Return the values that features of an image depend on."""
        return {
            f"{step.name}.{item.name}": getattr(getattr(self, step.name), item.name)
            for step in fields(self)
            for item in fields(getattr(self, step.name))
            if item.metadata.get("features")
        }

    def table(self, method: str) -> dict[str, Any]:
        """Return the values by step for a record; empty where version 0.1.0 had the same.

        Args:
            method: name of the method; only `adaptive` has the steps that are new since then.
        """
        values = asdict(self)
        new = {name: values.pop(name) for name in ADDED}
        text = json.dumps(values, sort_keys=True)
        digest = hashlib.sha256(text.encode()).hexdigest()[:12]
        usual = asdict(DEFAULT)
        changed = {name: step for name, step in new.items() if step != usual[name]}
        return ({} if digest == DIGEST_OF_0_1_0 else values) | (
            new if method == "adaptive" else changed
        )


DEFAULT = Constants()
