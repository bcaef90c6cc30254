"""Heights of places, read from an elevation model. Needs the extra `geo`."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearfar.errors import ImageError
from nearfar.runtime import require


def elevations(model: Path, world: NDArray[np.float64], crs: Any) -> NDArray[np.float64]:
    """Return the heights of places in the unit of an elevation model.

    Args:
        model: raster whose first band holds heights.
        world: (N, 2) easting and northing, or longitude and latitude.
        crs: rasterio's coordinate reference system of the places.

    Returns:
        (N,) heights of the pixels that hold the places; NaN where the model has none.

    Raises:
        ImageError: the model cannot be read, or has no coordinate system.
        MissingExtraError: the extra `geo` is not installed.
    """
    require("geo", "rasterio")
    import rasterio
    from rasterio.errors import RasterioError
    from rasterio.warp import transform

    try:
        with rasterio.open(model) as dataset:
            if dataset.crs is None or crs is None:
                raise ImageError(f"{model} and the far image need a coordinate system for heights")
            places = np.column_stack(transform(crs, dataset.crs, *world.T.tolist()))
            read = [each[0] for each in dataset.sample(places, indexes=1, masked=True)]
    except RasterioError as error:
        raise ImageError(f"the elevation model {model} cannot be read: {error}") from error
    return np.array([np.nan if value is np.ma.masked else float(value) for value in read])
