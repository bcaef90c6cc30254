"""Images: reading, warping, tiles and regions."""
