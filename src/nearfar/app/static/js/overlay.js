/** The near image warped into the frame of the far one, as blend or swipe shows it. */

import { loadPicture, warpedAddress } from "./api.js";
import { bounds, inverse, magnification, multiply } from "./geometry.js";

const LONGEST = 2600;

/**
 * @param {string} ref of the near image
 * @param {number[][]} farFromNear
 * @param {number[][]} footprint of the near image in the far image
 * @param {number[]} farSize
 * @returns {Promise<{picture: HTMLImageElement, box: number[]}|null>} the box is in far pixels
 */
export async function warpedOverlay(ref, farFromNear, footprint, farSize) {
  const [left, top, right, bottom] = bounds(footprint);
  const box = [
    Math.max(-0.5, Math.floor(left) - 0.5), Math.max(-0.5, Math.floor(top) - 0.5),
    Math.min(farSize[0] - 0.5, Math.ceil(right) + 0.5), Math.min(farSize[1] - 0.5, Math.ceil(bottom) + 0.5),
  ];
  const across = box[2] - box[0], down = box[3] - box[1];
  if (across < 2 || down < 2) return null;
  const centre = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
  const detail = Math.max(1, magnification(inverse(farFromNear), centre));
  const scale = Math.min(detail, LONGEST / Math.max(across, down));
  const width = Math.max(1, Math.round(across * scale)), height = Math.max(1, Math.round(down * scale));
  const [sx, sy] = [width / across, height / down];
  const frameFromFar = [[sx, 0, -box[0] * sx - 0.5], [0, sy, -box[1] * sy - 0.5], [0, 0, 1]];
  const picture = await loadPicture(warpedAddress(ref, multiply(frameFromFar, farFromNear), width, height));
  return { picture, box };
}
