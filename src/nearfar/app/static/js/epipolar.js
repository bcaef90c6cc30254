/** Epipolar lines: a point of one image lies on a line of the other. */

import { COLOURS } from "./marks.js";

const MOST = 12;

/** The line [a, b, c], ax + by + c = 0, of the image `role` on which a point of the other image lies; F: far·F·near = 0. */
export function epipolarLine(fundamental, role, [x, y]) {
  const point = [x, y, 1];
  const line = [0, 1, 2].map((i) => point.reduce((sum, value, j) => sum + value * (role === "near" ? fundamental[j][i] : fundamental[i][j]), 0));
  const length = Math.hypot(line[0], line[1]);
  return length > 0 ? line.map((value) => value / length) : null;
}

/** How far a match lies from its epipolar line in the far image, in pixels. */
export function epipolarError(fundamental, far, near) {
  const line = epipolarLine(fundamental, "far", near);
  return line && Math.abs(line[0] * far[0] + line[1] * far[1] + line[2]);
}

/** Draw the lines of some agreeing matches thin, and that of the place under the pointer thick. */
export function drawEpipolarLines(context, view, fundamental, role, step, pointer) {
  const other = role === "far" ? "near" : "far";
  const agreeing = step ? step[other].filter((_, i) => step.inliers[i]) : [];
  const every = Math.max(1, Math.ceil(agreeing.length / MOST)), [left, top] = view.toScreen([-0.5, -0.5]);
  context.save();
  context.beginPath();
  context.rect(left, top, view.size[0] * view.scale, view.size[1] * view.scale);
  context.clip();  // Beside the image a line tells nothing.
  context.globalAlpha = 0.55;
  for (let i = 0; i < agreeing.length; i += every) drawLine(context, view, epipolarLine(fundamental, role, agreeing[i]), COLOURS.suggestion, 1.2);
  context.globalAlpha = 1;
  if (pointer) drawLine(context, view, epipolarLine(fundamental, role, pointer), COLOURS.outline, 2.5);
  context.restore();
}

function drawLine(context, view, line, colour, width) {
  if (!line) return;
  const [a, b, c] = line, [across, down] = view.size;
  // The foot of the middle of the image, and the direction of the line from there.
  const off = (a * across + b * down) / 2 + c, foot = [across / 2 - off * a, down / 2 - off * b], reach = Math.hypot(across, down);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  context.moveTo(...view.toScreen([foot[0] - b * reach, foot[1] + a * reach]));
  context.lineTo(...view.toScreen([foot[0] + b * reach, foot[1] - a * reach]));
  context.stroke();
}
