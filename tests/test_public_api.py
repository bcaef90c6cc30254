"""The public API is this list; a change of it belongs in the changelog."""

import nearfar

PUBLIC = [
    "CameraIntrinsics",
    "ExportError",
    "GeoPlace",
    "Image",
    "ImageError",
    "ImageInfo",
    "Intrinsics",
    "IntrinsicsError",
    "LandmarkMatches",
    "Localization",
    "LocalizationError",
    "Localizer",
    "MapAnswer",
    "MapError",
    "MapLocalization",
    "NearfarError",
    "PointMatches",
    "QueryPose",
    "RelativePose",
    "Settings",
    "SettingsError",
    "WeightsError",
    "export",
    "localize",
    "localize_pairs",
    "open_map",
    "read_image",
    "read_images",
    "read_intrinsics",
    "save_localization",
]


def test_it_is_this_list() -> None:
    assert sorted(nearfar.__all__) == PUBLIC


def test_each_name_exists_and_tells_what_it_is() -> None:
    for name in PUBLIC:
        assert getattr(nearfar, name).__doc__


def test_an_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(nearfar, "localise")
