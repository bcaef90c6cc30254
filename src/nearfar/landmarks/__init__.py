"""Landmarks: boxes with descriptors, and their matches."""
