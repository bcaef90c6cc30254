"""Keypoints with descriptors, and their matches."""
