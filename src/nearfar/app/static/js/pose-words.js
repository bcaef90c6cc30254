/** Poses of cameras in words: how one camera is turned against another, and where it stands. */

import { h } from "./dom.js";
import { facts } from "./job-view.js";

const DEGREE = 180 / Math.PI, NONE = 0.05;

const degrees = (radians) => `${Math.abs(radians * DEGREE).toFixed(1)}°`;
const parts = (entries) => entries.filter(([angle]) => Math.abs(angle * DEGREE) >= NONE)
  .map(([angle, positive, negative]) => `${degrees(angle)} ${angle > 0 ? positive : negative}`).join(", ");

/** How the near camera is turned against the far one; R takes directions of the near camera to the far one. */
export function turnInWords(rotation) {
  const [[, , x], [a, b, y], [, , z]] = rotation;
  const text = parts([[Math.atan2(x, z), "to the right", "to the left"], [Math.asin(Math.min(1, Math.max(-1, -y))), "up", "down"], [Math.atan2(a, b), "clockwise", "anticlockwise"]]);
  return text || "not turned";
}

/** In which direction the near camera stands, as the far camera sees it. */
export function directionInWords([x, y, z]) {
  const level = Math.hypot(x, z), side = Math.atan2(x, Math.abs(z)), height = Math.atan2(-y, level);
  const text = parts([[side, "to the right", "to the left"], [height, "up", "down"]]);
  return [z >= 0 ? "ahead" : "behind", text].filter(Boolean).join(", ");
}

/** The root of the mean variance of three numbers of a covariance. */
function deviation(covariance, first) {
  return covariance && Math.sqrt([0, 1, 2].reduce((sum, i) => sum + covariance[first + i][first + i], 0) / 3);
}

/** A relative pose of a pair: {rotation, translation, covariance}. */
export function relativePose(pose) {
  const [turn, move] = [deviation(pose.covariance, 0), deviation(pose.covariance, 3)];
  return h("section", { class: "pose", "aria-label": "Pose" }, h("h2", {}, "The near camera, seen from the far one"), facts([
    ["Turned", turnInWords(pose.rotation)],
    ["Stands", directionInWords(pose.translation)],
    turn && ["Exact within", `${degrees(turn)} turn, ${degrees(move)} direction`],
  ]), h("p", { class: "quiet small" }, "Two images alone do not tell how far apart the cameras are."));
}

/** The pose of a camera in the world of a map. */
export function worldPose(pose) {
  const { rotation, translation } = pose.world_from_query;
  const look = rotation.map((row) => row[2]), spread = deviation(pose.covariance, 3);
  const list = (values) => values.map((value) => value.toFixed(2)).join(", ");
  return h("section", { class: "pose", "aria-label": "Pose" }, h("h2", {}, `Camera in ${pose.world}`), facts([
    translation ? ["Position x, y, z", list(translation)] : ["Direction to it", list(pose.direction)],
    spread && ["Exact within", `${spread.toPrecision(2)} units`],
    ["Looks to x, y, z", list(look)],
    ["Matches that agree", String(pose.inliers)],
  ]), !translation && h("p", { class: "quiet small" }, "One map image gives the direction to the camera alone."));
}
