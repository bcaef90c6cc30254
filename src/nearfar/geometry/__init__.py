"""Homography, epipolar geometry, relative pose and their errors."""
