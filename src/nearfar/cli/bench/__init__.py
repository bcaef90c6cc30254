"""`nearfar bench`. One module a benchmark."""

from cyclopts import App

from nearfar.cli.bench.landmarks_command import landmarks_command
from nearfar.cli.bench.pairs_command import kitti_command, pairs_command
from nearfar.cli.bench.scale_curve_command import scale_curve_command
from nearfar.cli.bench.sweep_command import sweep_command

bench_app = App(name="bench", help="Measure methods on real images with ground truth.")
bench_app.command(pairs_command, name="pairs")
bench_app.command(kitti_command, name="kitti")
bench_app.command(scale_curve_command, name="scale-curve")
bench_app.command(sweep_command, name="sweep")
bench_app.command(landmarks_command, name="landmarks")
