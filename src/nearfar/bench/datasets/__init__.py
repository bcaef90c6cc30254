"""Benchmark data: pairs and sequences of images, stereo depth and made cases."""
