"""Training of the landmark descriptor that ships with nearfar; needs the extra `train`."""
