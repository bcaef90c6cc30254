/** What may help where a pair was not found, or looks swapped: each is one click. */

import { post } from "./api.js";
import { h, icon, toast } from "./dom.js";

/** The same pair with the roles swapped. */
function swapped(request) {
  return { ...request, far: request.near, near: request.far, far_mask: request.near_mask, near_mask: request.far_mask, far_camera: request.near_camera, near_camera: request.far_camera };
}

async function localize(request) {
  try {
    const job = await post("/api/jobs", request);
    location.hash = `#/localize/${job.id}`;
  } catch (error) {
    toast(error.message, "error");
  }
}

/**
 * @param {object} request of the job that has ended
 * @param {object} found its localization
 * @returns {HTMLElement|null}
 */
export function offers(request, found) {
  const failed = found.status !== "localized", small = !failed && found.scale_change !== null && found.scale_change < 1;
  if (!failed && !small) return null;
  const offer = (text, why, changed) => h("li", {}, h("button", { type: "button", onclick: () => localize(changed) }, icon("again"), text),
    h("span", { class: "quiet small" }, why));
  const other = request.model === "homography" ? "fundamental" : "homography";
  return h("section", { class: "offers", "aria-label": "What may help" }, h("h2", {}, small ? "Roles swapped?" : "What may help"), h("ul", {},
    offer("Swap far and near", small ? "The near image shows the scene smaller than the far one." : "If the first image is the close-up.", swapped(request)),
    failed && offer(other === "fundamental" ? "As a scene with depth" : "As a flat scene",
      other === "fundamental" ? "If the camera moved, and the scene is not flat." : "If the scene is flat, or the camera only turned.",
      { ...request, model: other }),
    failed && request.max_effort !== "views" && offer("Try everything", "All steps, which takes longer.", { ...request, max_effort: "views" })));
}
