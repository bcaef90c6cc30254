"""The adaptive localizer: points first, and only where they fail what costs more."""

from nearfar.methods.adaptive.method import Adaptive
from nearfar.methods.adaptive.pair import AdaptiveFeatures

__all__ = ["Adaptive", "AdaptiveFeatures"]
