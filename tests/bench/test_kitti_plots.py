"""Which translation error is drawn."""

from nearfar.bench.figures import kitti_plots
from nearfar.bench.results import Result


def test_lengths_from_stereo_and_unit_lengths_are_not_mixed() -> None:
    pose = {"case": "a", "method": "sift"}
    with_stereo = Result.from_dict(pose | {"t_err_stereo": 0.05, "t_err_unit": 0.67})
    without = Result.from_dict(pose | {"t_err_stereo": None, "t_err_unit": 0.8})
    plot = kitti_plots([with_stereo, with_stereo])["translation_error"]
    assert (plot.label, plot.value(with_stereo)) == ("t_err, length from stereo", 0.05)
    plot = kitti_plots([with_stereo, without])["translation_error"]
    assert (plot.label, plot.value(with_stereo), plot.value(without)) == (
        "t_err, unit length",
        0.67,
        0.8,
    )
