/** A view from above, for tracks of poses: places of the world on a blank picture with a grid. */

import { bounds } from "./geometry.js";

const SIDE = 1200, ROOM = 0.12, LEAST = 0.35, LINES = 6;

/** The least of 1, 2 and 5 times a power of ten that is not below a number. */
function roundStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((each) => each * power).find((each) => each >= least * 0.999);
}

/**
 * @param {number[][]} places in units of the world, to the right and up
 * @param {string[]} names of these axes
 */
export function planOf(places, names) {
  const [left, low, right, high] = bounds(places), extent = Math.max(right - left, high - low, 1e-9);
  const room = [right - left, high - low].map((each) => Math.max(ROOM * extent, (LEAST * extent - each) / 2));
  const start = [left - room[0], low - room[1]], end = [right + room[0], high + room[1]];
  const scale = SIDE / Math.max(end[0] - start[0], end[1] - start[1]);
  const size = [0, 1].map((k) => Math.ceil((end[k] - start[k]) * scale));
  const picture = document.createElement("canvas");
  [picture.width, picture.height] = size;
  const at = ([x, y]) => [(x - start[0]) * scale, size[1] - (y - start[1]) * scale];
  const step = roundStep(Math.max(end[0] - start[0], end[1] - start[1]) / LINES);
  return { picture, size, at, drawGrid: (context, view) => grid(context, view, { start, end, step, at, names }) };
}

function grid(context, view, { start, end, step, at, names }) {
  const style = getComputedStyle(view.element), line = style.getPropertyValue("--line-strong"), text = style.getPropertyValue("--quiet");
  context.font = "12px system-ui, sans-serif";
  context.lineWidth = 1;
  for (const axis of [0, 1]) {
    for (let value = Math.ceil(start[axis] / step) * step; value < end[axis]; value += step) {
      const from = [...start], to = [...end];
      from[axis] = to[axis] = value;
      const a = view.toScreen(at(from)), b = view.toScreen(at(to));
      context.strokeStyle = line;
      context.beginPath();
      context.moveTo(...a);
      context.lineTo(...b);
      context.stroke();
      context.fillStyle = text;
      const number = String(Number(value.toPrecision(6)));
      if (axis === 0) context.fillText(number, a[0] + 4, Math.min(a[1], view.height) - 6);
      else context.fillText(number, Math.max(a[0], 0) + 4, a[1] - 4);
    }
  }
  context.fillStyle = text;
  context.font = "600 13px system-ui, sans-serif";
  context.fillText(`${names[0]} →`, view.width - 36, view.height - 10);
  context.fillText(`${names[1]} ↑`, 8, 18);
}
