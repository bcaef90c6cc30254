"""The hash of settings, by which rows of an earlier version are found again."""

from nearfar.settings import Settings
from nearfar.storage.rows import settings_key, settings_table


def test_settings_of_the_first_version_keep_their_key() -> None:
    """nearfar 0.1.0 had no detector and no matcher; their defaults do not change the key."""
    settings = Settings(method="sift", descriptor="hog")
    assert settings_key(settings) == "cfd7128a5014"
    assert "detector" not in settings_table(settings)


def test_another_detector_or_matcher_is_another_key() -> None:
    settings = Settings(method="points", descriptor="hog")
    others = [settings.replace(detector="orb"), settings.replace(matcher="mnn")]
    assert len({settings_key(each) for each in (settings, *others)}) == 3
    assert settings_table(others[0])["detector"] == "orb"
