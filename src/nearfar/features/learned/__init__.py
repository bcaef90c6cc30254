"""Learned features and their matchers: ALIKED, DISK and XFeat, with LightGlue and LighterGlue.

Those of kornia need the extra `learned`. Their weights are read from packages that carry them, and
checked. One more reads ONNX files and needs no extra. Nothing is loaded before the first image.
"""

from nearfar.features.learned.detector import LearnedFeatures
from nearfar.features.learned.matchers import LightGlueMatcher, XFeatMatcher
from nearfar.features.learned.onnx_matcher import OnnxMatcher

__all__ = ["LearnedFeatures", "LightGlueMatcher", "OnnxMatcher", "XFeatMatcher"]
