"""Places on the Earth as text."""

from nearfar.maps.world.places import DEGREE_DECIMALS, GeoPlace

LONGEST_CRS = 20
"""Longest name of a coordinate system to print, in characters; WKT can fill pages."""


def place_text(place: GeoPlace) -> str:
    """Return the centre of a query, its heading, resolution and expected error, in their units."""
    crs = place.crs if len(place.crs) <= LONGEST_CRS else "the raster's system"
    parts = [f"{place.printed(place.outline.centre)} in {crs}"]
    if place.longitude_latitude is not None:
        longitude, latitude = place.longitude_latitude.centre
        parts.insert(
            0,
            f"longitude {longitude:.{DEGREE_DECIMALS}f}, latitude {latitude:.{DEGREE_DECIMALS}f}",
        )
    if place.heading is not None and place.resolution is not None:
        parts.append(f"heading {place.heading:.0f}°, {place.resolution:.2g} m a pixel")
    if place.error is not None:
        parts.append(f"expected error {place.error:.2g} m")
    return "; ".join(parts)


def corners_text(place: GeoPlace) -> str:
    """Return the corners of a query in the coordinate system of the far image."""
    outline = place.outline.footprint
    return "  ".join(place.printed(corner) for corner in outline[:: len(outline) // 4])
