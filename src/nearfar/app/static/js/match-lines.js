/** Lines from matched points of one view to those of another, on a canvas that lies over both. */

import { COLOURS } from "./marks.js";

const MOST = 300;

/** @typedef {{far: number[], near: number[], agrees: boolean}} Match */

/**
 * @param {HTMLCanvasElement} canvas that fills its parent
 * @param {CanvasView} farView
 * @param {CanvasView} nearView
 * @param {Match[]} matches drawn thin, of very many every so-manieth
 * @param {Match|null} lit drawn thick
 */
export function drawMatchLines(canvas, farView, nearView, matches, lit) {
  const frame = canvas.parentElement.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
  const width = Math.round(frame.width * ratio), height = Math.round(frame.height * ratio);
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, frame.width, frame.height);
  const from = placer(farView, frame), to = placer(nearView, frame);
  const line = (match, lineWidth, alpha) => {
    const start = from(match.far), end = to(match.near);
    if (!start || !end) return;
    context.globalAlpha = alpha;
    context.strokeStyle = match.agrees ? COLOURS.agrees : COLOURS.differs;
    context.lineWidth = lineWidth;
    context.beginPath();
    context.moveTo(...start);
    context.lineTo(...end);
    context.stroke();
  };
  const every = Math.max(1, Math.ceil(matches.length / MOST));
  for (let i = 0; i < matches.length; i += every) line(matches[i], 1, 0.5);
  if (lit) line(lit, 2, 1);
}

/** Where a point of a view lies in the frame; null where it is not shown. */
function placer(view, frame) {
  const pane = view.canvas.getBoundingClientRect();
  return (point) => {
    const [x, y] = view.toScreen(point);
    const shown = x >= 0 && y >= 0 && x <= view.width && y <= view.height;
    return shown ? [x + pane.left - frame.left, y + pane.top - frame.top] : null;
  };
}
