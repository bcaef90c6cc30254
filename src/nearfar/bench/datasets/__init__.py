"""Benchmark data: pairs of images, KITTI sequences and made cases."""
