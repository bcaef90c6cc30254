"""A camera followed through a map. Needs the extra `map`."""

from nearfar.tracking.pose_tracker import PoseTracker
from nearfar.tracking.state import TrackState
from nearfar.tracking.tracker import Tracker

__all__ = ["PoseTracker", "TrackState", "Tracker"]
