"""Constants of the tracker; lengths in a window are pixels of the window."""

from dataclasses import dataclass, field

from nearfar.constants import DEFAULT, Constants

BUDGET = 3.0
"""Seconds that an update may take by default: 2.5 times as long as the search of a map that found a
frame took, and 80 times as long as a tracked frame."""


@dataclass(frozen=True, kw_only=True)
class WindowConstants:
    """The part of a map image around the expected place, and how large it is shown."""

    longest_side: float = 240.0
    """Longest side of the expected footprint in the window, in pixels."""
    most_enlarged: float = 2.0
    """Largest factor by which the map image is enlarged: there is no detail to gain."""
    room: float = 0.25
    """Room on each side of the footprint when a window is made, as a share of its longest side."""
    ahead: float = 6.0
    """Frames for which a new window has room in the direction of the motion..."""
    most_ahead: float = 0.75
    """...at most so much, as a share of the footprint's longest side."""
    least_room: float = 0.1
    """Room below which a new window is made."""
    rescaled: float = 1.5
    """Factor by which the wanted enlargement may change before a new window is made."""
    kept: int = 4
    """Windows that are kept: one for each hypothesis that is followed."""
    contrast: float = 0.01
    """SIFT's contrast threshold, as in the zoom of `adaptive`."""
    map_points: int = 2000
    """Most keypoints of a window, those of the highest contrast."""
    frame_points: int = 300
    """Most keypoints of a frame."""


@dataclass(frozen=True, kw_only=True)
class MatchConstants:
    """Matching of a frame with a window."""

    ratio: float = 0.9
    """Ratio test among the keypoints within reach, as in the zoom of `adaptive`."""
    cell: float = 96.0
    """Side of the grid cells in which keypoints are compared, in pixels of the window."""
    size_tolerance: float = 1.7
    """Factor by which the sizes of matched keypoints may differ."""
    angle_tolerance: float = 40.0
    """Angle by which their orientations may differ, in degrees."""
    least_reach: float = 0.04
    """Least distance of a match from its expected position, as a share of the footprint's
    diagonal..."""
    most_reach: float = 0.25
    """...and the largest one at the predicted place..."""
    wide_reach: float = 0.5
    """...and in its neighbourhood."""
    narrow_reach: float = 0.02
    """Reach of the last matching, at the place that was found."""
    deviations: float = 3.0
    """Standard deviations of the prediction within which a match may lie."""
    least_confidence: float = 0.5
    """Confidence below which an answer is no measurement."""
    least_stiff: int = 8
    """Inliers that a similarity transform from the predicted place needs."""
    bend: float = 0.01
    """Change of the shape of a footprint from frame to frame that a similarity transform leaves
    out, as a share of its half diagonal."""
    gate: float = 5.0
    """Largest distance of an answer from the prediction in standard deviations; 4 numbers of a
    normal distribution exceed 5 in one of 20,000 cases."""
    rival: float = 0.6
    """Support of another place in the neighbourhood, as a share of the best one's, from which on
    the neighbourhood is ambiguous."""


@dataclass(frozen=True, kw_only=True)
class MotionConstants:
    """What the tracker expects of the camera's motion; lengths are shares of the footprint."""

    first_move: float = 0.35
    """Standard deviation of the first move, as a share of the footprint's half diagonal."""
    first_scaling: float = 0.15
    """Standard deviation of the first change of the logarithm of the scale."""
    first_turn: float = 10.0
    """Standard deviation of the first turn, in degrees."""
    memory: float = 0.2
    """Weight of the latest surprise in the running mean of squared accelerations."""
    least_surprise: float = 0.02
    """Least standard deviation of a prediction by acceleration, as a share of the first move's."""
    lost: float = 0.5
    """Standard deviation of the place, in half diagonals of the footprint, from which on the camera
    is lost..."""
    given_up: float = 2.0
    """...and from which on it is not sought at that place any more."""


@dataclass(frozen=True, kw_only=True)
class HypothesisConstants:
    """Places that are followed until frames decide."""

    most: int = 5
    """Most places that are followed."""
    least_weight: float = 0.02
    """Share of all weights below which a place is given up."""
    missed: float = 0.3
    """Factor on the weight of a place at which a frame does not match while it does elsewhere."""
    power: float = 2.0
    """Power of the share of inliers, relative to the best place, that multiplies the weight."""
    same: float = 0.1
    """Distance of two places that are one, in half diagonals of the footprint."""


@dataclass(frozen=True, kw_only=True)
class OdometryConstants:
    """Motion between two frames."""

    longest_side: int = 320
    """Longest side of the reduced frames, in pixels."""
    points: int = 500
    """Most keypoints of a frame."""
    contrast: float = 0.02
    """SIFT's contrast threshold."""
    ratio: float = 0.85
    """Ratio test over the whole frame."""
    least_inliers: int = 15
    """Inliers below which the motion is not known."""
    drift: float = 0.01
    """Standard deviation that a step adds, as a share of the footprint's half diagonal."""


@dataclass(frozen=True, kw_only=True)
class RecoveryConstants:
    """Global localization of a lost camera."""

    patience: int = 2
    """Frames that are only predicted before the whole map is searched."""
    longest_pause: int = 8
    """Most frames between two searches; the pauses grow with the frames that were missed."""
    least_points: int = 30
    """Keypoints below which a frame shows too little to search the map for it."""
    least_confidence: float = 0.5
    """Least confidence of an answer that is followed."""


@dataclass(frozen=True, kw_only=True)
class TrackingConstants:
    """Constants of all steps; those of acceptance and of the error are the method's."""

    window: WindowConstants = field(default_factory=WindowConstants)
    match: MatchConstants = field(default_factory=MatchConstants)
    motion: MotionConstants = field(default_factory=MotionConstants)
    hypotheses: HypothesisConstants = field(default_factory=HypothesisConstants)
    odometry: OdometryConstants = field(default_factory=OdometryConstants)
    recovery: RecoveryConstants = field(default_factory=RecoveryConstants)
    method: Constants = DEFAULT


TRACKING = TrackingConstants()
