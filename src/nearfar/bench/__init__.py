"""Benchmarks on real images with ground truth."""
