"""Which translation error is drawn."""

from nearfar.bench.studies.kitti_summary import plots


def test_lengths_from_stereo_and_unit_lengths_are_not_mixed() -> None:
    with_stereo = {"t_err_stereo": 0.05, "t_err_unit": 0.67}
    without = {"t_err_stereo": None, "t_err_unit": 0.8}
    label, value, _ = plots([with_stereo, with_stereo])["translation_error"]
    assert (label, value(with_stereo)) == ("t_err, length from stereo", 0.05)
    label, value, _ = plots([with_stereo, without])["translation_error"]
    assert (label, value(with_stereo), value(without)) == ("t_err, unit length", 0.67, 0.8)
