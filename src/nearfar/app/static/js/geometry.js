/** Homographies: 3×3 rows; points are [x, y], pixel centres at integers. */

export function transform(m, [x, y]) {
  const w = m[2][0] * x + m[2][1] * y + m[2][2];
  return [(m[0][0] * x + m[0][1] * y + m[0][2]) / w, (m[1][0] * x + m[1][1] * y + m[1][2]) / w];
}

export function multiply(a, b) {
  return a.map((row) => [0, 1, 2].map((j) => row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]));
}

export function inverse(m) {
  const [[a, b, c], [d, e, f], [g, i, j]] = m;
  const A = e * j - f * i, B = f * g - d * j, C = d * i - e * g;
  const determinant = a * A + b * B + c * C;
  return [
    [A, c * i - b * j, b * f - c * e],
    [B, a * j - c * g, c * d - a * f],
    [C, b * g - a * i, a * e - b * d],
  ].map((row) => row.map((value) => value / determinant));
}

/** How many output pixels one input pixel becomes at a place, in length. */
export function magnification(m, [x, y]) {
  const step = 0.5, [x0, y0] = transform(m, [x, y]);
  const [x1, y1] = transform(m, [x + step, y]), [x2, y2] = transform(m, [x, y + step]);
  return Math.sqrt(Math.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))) / step;
}

/** Outer corners of an image, half a pixel outside the centres of its corner pixels. */
export function outline([width, height]) {
  return [[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]];
}

/** Outline of an image in another; null where the horizon crosses it. */
export function footprint(m, size) {
  const corners = outline(size);
  const depths = corners.map(([x, y]) => m[2][0] * x + m[2][1] * y + m[2][2]);
  if (!(depths.every((d) => d > 0) || depths.every((d) => d < 0))) return null;
  const mapped = corners.map((corner) => transform(m, corner));
  return mapped.flat().every(Number.isFinite) ? mapped : null;
}

export function distance([ax, ay], [bx, by]) {
  return Math.hypot(ax - bx, ay - by);
}

export function inside([x, y], [width, height]) {
  return x >= -0.5 && y >= -0.5 && x <= width - 0.5 && y <= height - 0.5;
}

/** [left, top, right, bottom] of points. */
export function bounds(points) {
  const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
  return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
}
