/** Marks of frames on a map: each state has a shape of its own, beside its colour. */

import { label } from "./marks.js";

export const TRACK_COLOURS = { tracked: "#4cc2ff", relocalized: "#3ddc97", predicted: "#ffb347", lost: "#ff6b6b" };
const HALO = "rgba(0, 0, 0, 0.6)", SIZE = 4;

const SHAPES = {
  tracked: (path, x, y, r) => { path.moveTo(x + r, y); path.arc(x, y, r, 0, 7); },
  relocalized: (path, x, y, r) => { path.moveTo(x, y - 1.5 * r); path.lineTo(x + 1.5 * r, y); path.lineTo(x, y + 1.5 * r); path.lineTo(x - 1.5 * r, y); path.closePath(); },
  predicted: (path, x, y, r) => { path.moveTo(x + r, y); path.arc(x, y, r, 0, 7); },
  lost: (path, x, y, r) => { path.moveTo(x - r, y - r); path.lineTo(x + r, y + r); path.moveTo(x + r, y - r); path.lineTo(x - r, y + r); },
};
/** Rings and crosses are drawn by their lines alone. */
const OPEN = ["predicted", "lost"];

/** Lines between neighbouring frames; a place that is not known interrupts them. */
export function trackLine(context, view, frames) {
  const path = new Path2D();
  let before = null;
  for (const { place, index } of frames) {
    const at = place && view.toScreen(place);
    if (at && before && before.index === index - 1) { path.moveTo(...before.at); path.lineTo(...at); }
    before = at && { at, index };
  }
  for (const [style, width] of [[HALO, 4], ["#fff", 1.8]]) {
    context.strokeStyle = style;
    context.lineWidth = width;
    context.stroke(path);
  }
}

/** Marks of all frames, smaller where they are close together. */
export function trackMarks(context, view, frames) {
  const step = frames.length > 1 ? Math.hypot(...[0, 1].map((k) => span(frames, k))) / frames.length * view.scale : 99;
  const radius = Math.min(SIZE, Math.max(1.6, step * 0.45));
  for (const [status, shape] of Object.entries(SHAPES)) {
    const path = new Path2D();
    for (const { place } of frames.filter((each) => each.status === status && each.place)) shape(path, ...view.toScreen(place), radius);
    mark(context, path, status, 1);
  }
}

function mark(context, path, status, extra) {
  context.lineJoin = "round";
  context.strokeStyle = HALO;
  context.lineWidth = 3 + extra;
  context.stroke(path);
  if (OPEN.includes(status)) {
    context.strokeStyle = TRACK_COLOURS[status];
    context.lineWidth = 1 + extra;
    context.stroke(path);
  } else {
    context.fillStyle = TRACK_COLOURS[status];
    context.fill(path);
  }
}

function span(frames, axis) {
  const values = frames.filter((each) => each.place).map((each) => each.place[axis]);
  return values.length ? Math.max(...values) - Math.min(...values) : 0;
}

/** The mark of the chosen frame, larger, with its number. */
export function chosenMark(context, view, frame) {
  if (!frame.place) return;
  const path = new Path2D();
  SHAPES[frame.status](path, ...view.toScreen(frame.place), 7);
  mark(context, path, frame.status, 2);
  label(context, view, frame.place, String(frame.index + 1));
}

/** The mark of a state as an element, for legends and lists. */
export function markElement(status) {
  const canvas = document.createElement("canvas"), ratio = window.devicePixelRatio || 1;
  canvas.width = canvas.height = 18 * ratio;
  canvas.className = "track-mark";
  canvas.setAttribute("aria-hidden", "true");
  const context = canvas.getContext("2d"), path = new Path2D();
  context.scale(ratio, ratio);
  SHAPES[status](path, 9, 9, 4.5);
  mark(context, path, status, 1);
  return canvas;
}
