/** Places on the Earth, laid on a plane around their middle; north is up. */

const METRES_PER_DEGREE = 111195, SPAN = 4000, LEAST_METRES = 20;
export const WGS84 = "EPSG:4326";

/** Points of the plane are [x, y]; x grows to the east, y to the south, and `unit` is the side of one in metres. */
export class Plane {
  /** @param {string} system name of the coordinate system @param {number[][]} points of it */
  constructor(system, points) {
    this.degrees = system === WGS84;
    this.system = system;
    const [xs, ys] = [0, 1].map((axis) => points.map((point) => point[axis]));
    const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    this.middle = [(left + right) / 2, (low + high) / 2];
    this.stretch = this.degrees ? [METRES_PER_DEGREE * Math.cos((this.middle[1] * Math.PI) / 180), METRES_PER_DEGREE] : [1, 1];
    const sides = [(right - left) * this.stretch[0], (high - low) * this.stretch[1]].map((side) => Math.max(LEAST_METRES, side * 1.08));
    this.unit = Math.max(...sides) / SPAN;
    this.size = sides.map((side) => side / this.unit);
  }

  fromWorld(point) {
    const [east, north] = point.map((value, axis) => ((value - this.middle[axis]) * this.stretch[axis]) / this.unit);
    return [this.size[0] / 2 + east, this.size[1] / 2 - north];
  }

  toWorld([x, y]) {
    const offset = [x - this.size[0] / 2, this.size[1] / 2 - y];
    return offset.map((value, axis) => this.middle[axis] + (value * this.unit) / this.stretch[axis]);
  }

  /** Coordinates as text: longitude and latitude in degrees, or x and y. */
  words(point) {
    const [x, y] = this.toWorld(point);
    if (!this.degrees) return `x ${x.toFixed(2)}, y ${y.toFixed(2)}`;
    return `${Math.abs(y).toFixed(6)}° ${y < 0 ? "S" : "N"}, ${Math.abs(x).toFixed(6)}° ${x < 0 ? "W" : "E"}`;
  }

  /** The longest round length that fits into so many units: [units, text]. */
  scaleBar(units) {
    const most = units * this.unit, power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map((each) => each * power).find((each) => each <= most);
    const metric = this.degrees || /^EPSG:(326|327|25|3857)/.test(this.system);
    const text = !metric ? `${length} units` : length >= 1000 ? `${length / 1000} km` : length >= 1 ? `${length} m` : `${+(length * 100).toPrecision(3)} cm`;
    return [length / this.unit, text];
  }
}
