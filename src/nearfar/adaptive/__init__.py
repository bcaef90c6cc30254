"""The steps of the adaptive localizer: keypoints, votes, search, zoom, views, confidence."""
