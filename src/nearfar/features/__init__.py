"""Keypoints with descriptors: detection and matching; maps of features."""
