"""Where a query lies in the world: by GeoTIFFs, COLMAP models or lists of poses."""
