"""Learned features and their matchers: ALIKED, DISK and XFeat, with LightGlue and LighterGlue.

The networks are those of kornia and need the extra `learned`. The weights are read from packages
that carry them, and checked. Nothing is loaded before the first image.
"""

from nearfar.features.learned.matchers import LearnedFeatures, LightGlueMatcher, XFeatMatcher

__all__ = ["LearnedFeatures", "LightGlueMatcher", "XFeatMatcher"]
