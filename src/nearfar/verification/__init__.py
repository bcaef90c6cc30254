"""Verification of a model: significance, degeneracy, conditioning, confidence, acceptance."""
