"""`nearfar bench`. One module a benchmark."""

from cyclopts import App

from nearfar.cli.bench.kitti_command import kitti_command
from nearfar.cli.bench.pairs_command import pairs_command

bench_app = App(name="bench", help="Measure methods on real images with ground truth.")
bench_app.command(pairs_command, name="pairs")
bench_app.command(kitti_command, name="kitti")
