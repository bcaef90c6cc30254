"""Is this model good? Significance, degeneracy, conditioning, confidence and acceptance."""
