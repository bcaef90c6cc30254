"""Many pairs of images at once: lists, resumable results, contact sheets."""
