/** What is drawn over images. Colours are the same in light and dark, since images are neither. */

export const COLOURS = {
  outline: "#ff7a1a",
  agrees: "#19c3a6",
  differs: "#ff4d6d",
  landmark: "#ffd23f",
  suggestion: "#7cc4ff",
  target: "#ffffff",
};
const HALO = "rgba(0, 0, 0, 0.55)";
const RIM = 0.8;

function stroke(context, colour, width, path) {
  context.lineJoin = "round";
  for (const [style, extra] of [[HALO, 2], [colour, 0]]) {
    context.strokeStyle = style;
    context.lineWidth = width + extra;
    context.stroke(path);
  }
}

export function polygon(context, view, points, colour = COLOURS.outline, width = 2.5) {
  const path = new Path2D();
  points.map((p) => view.toScreen(p)).forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
  path.closePath();
  stroke(context, colour, width, path);
}

/** Areas that are left out, shaded. */
export function areas(context, view, polygons) {
  const path = new Path2D();
  for (const points of polygons) {
    points.map((p) => view.toScreen(p)).forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
    path.closePath();
  }
  context.fillStyle = "rgba(10, 14, 18, 0.62)";
  context.fill(path);
  if (polygons.length) stroke(context, COLOURS.target, 1.2, path);
}

/** Outlines of places that nothing confirms: dashed, with their numbers. */
export function unverified(context, view, outlines, chosen) {
  context.setLineDash([7, 5]);
  outlines.forEach((points, i) => points && polygon(context, view, points, COLOURS.suggestion, i === chosen ? 3.5 : 1.8));
  context.setLineDash([]);
  outlines.forEach((points, i) => points && label(context, view, points[0], String(i + 1), COLOURS.suggestion));
}

/** The top edge of the near image, so that its rotation can be seen. */
export function topEdge(context, view, [first, second], colour = COLOURS.outline) {
  const path = new Path2D();
  path.moveTo(...view.toScreen(first));
  path.lineTo(...view.toScreen(second));
  stroke(context, colour, 5, path);
}

export function box(context, view, [x, y, width, height], colour, lineWidth = 1.5) {
  const [left, top] = view.toScreen([x - 0.5, y - 0.5]), [right, bottom] = view.toScreen([x + width - 0.5, y + height - 0.5]);
  const path = new Path2D();
  path.rect(left, top, right - left, bottom - top);
  stroke(context, colour, lineWidth, path);
}

/** Many dots at once. */
export function dots(context, view, points, colour, radius = 2.6) {
  const rim = new Path2D(), core = new Path2D();
  for (const point of points) {
    const [x, y] = view.toScreen(point);
    if (x < -9 || y < -9 || x > view.width + 9 || y > view.height + 9) continue;
    rim.moveTo(x + radius + RIM, y);
    rim.arc(x, y, radius + RIM, 0, 7);
    core.moveTo(x + radius, y);
    core.arc(x, y, radius, 0, 7);
  }
  context.fillStyle = HALO;
  context.fill(rim);
  context.fillStyle = colour;
  context.fill(core);
}

export function ring(context, view, point, colour, radius = 9, width = 2) {
  const [x, y] = view.toScreen(point);
  const path = new Path2D();
  path.arc(x, y, radius, 0, 7);
  stroke(context, colour, width, path);
}

/** A cross with a gap in the middle, so that the place itself can be seen. */
export function cross(context, view, point, colour, { arm = 11, gap = 3, width = 1.6, dash = [] } = {}) {
  const [x, y] = view.toScreen(point);
  const path = new Path2D();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    path.moveTo(x + dx * gap, y + dy * gap);
    path.lineTo(x + dx * arm, y + dy * arm);
  }
  context.setLineDash(dash);
  stroke(context, colour, width, path);
  context.setLineDash([]);
}

export function label(context, view, point, text, colour = "#fff") {
  const [x, y] = view.toScreen(point);
  context.font = "600 12px system-ui, sans-serif";
  context.textBaseline = "middle";
  context.lineWidth = 3.5;
  context.lineJoin = "round";
  context.strokeStyle = "rgba(0, 0, 0, 0.75)";
  context.strokeText(text, x + 9, y - 11);
  context.fillStyle = colour;
  context.fillText(text, x + 9, y - 11);
}

/** A dashed circle around a place where a point is wanted. */
export function wanted(context, view, point, text, current) {
  const [x, y] = view.toScreen(point);
  context.setLineDash([5, 4]);
  ring(context, view, point, COLOURS.target, current ? 17 : 13, current ? 2.5 : 1.5);
  context.setLineDash([]);
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.lineWidth = 3;
  context.strokeStyle = "rgba(0, 0, 0, 0.7)";
  context.strokeText(text, x, y);
  context.fillStyle = COLOURS.target;
  context.fillText(text, x, y);
  context.textAlign = "start";
}

/** A magnified piece of a picture around a point, with a cross at it. */
export function patch(canvas, view, point, scale) {
  const context = canvas.getContext("2d"), ratio = window.devicePixelRatio || 1;
  const side = canvas.clientWidth || 96;
  canvas.width = canvas.height = Math.round(side * ratio);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, side, side);
  if (!view.picture || !point) return;
  context.imageSmoothingEnabled = scale < 4;
  const [width, height] = view.size;
  const left = side / 2 - (point[0] + 0.5) * scale, top = side / 2 - (point[1] + 0.5) * scale;
  context.drawImage(view.picture, left, top, width * scale, height * scale);
  const origin = [side / 2 - point[0] * scale, side / 2 - point[1] * scale];
  view.tiles?.draw(context, {
    scale, width: side, height: side,
    toScreen: (p) => p.map((at, i) => at * scale + origin[i]), toImage: (p) => p.map((at, i) => (at - origin[i]) / scale),
  }, false);
  const centre = { toScreen: () => [side / 2, side / 2] };
  cross(context, centre, [0, 0], "#fff", { arm: side / 5, gap: 5, width: 1.2 });
}
