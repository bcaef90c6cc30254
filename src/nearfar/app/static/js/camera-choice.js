/** The choice of a camera: not known, from EXIF, estimated, or typed or read from a file. */

import { h, toast } from "./dom.js";

const LARGEST = 20_000;
const SOURCES = {
  none: "Not known",
  exif: "From the photographs (EXIF)",
  estimate: "Estimate from the matches",
  given: "Type it, or choose a file",
};

/**
 * @param {string} id of the control
 * @param {string} text its label
 * @param {string[]} sources of those above
 * @param {() => void} changed is called after each change
 * @returns {{element: HTMLElement, value: string|null, complete: boolean}}
 */
export function cameraChoice(id, text, sources, changed = () => {}) {
  const select = h("select", { id, onchange: () => { given.hidden = select.value !== "given"; changed(); } }, sources.map((each) => h("option", { value: each }, SOURCES[each])));
  const typed = h("textarea", { id: `${id}-text`, rows: "3", spellcheck: "false", maxlength: String(LARGEST), placeholder: "PINHOLE:fx,fy,cx,cy", oninput: changed });
  const file = h("input", { type: "file", accept: ".txt,.yaml,.yml,.json,.xml", onchange: () => take() });
  const take = async () => {
    const [chosen] = file.files;
    if (!chosen) return;
    if (chosen.size > LARGEST) toast(`${chosen.name} is larger than a camera file may be.`, "error");
    else typed.value = await chosen.text();
    file.value = "";
    changed();
  };
  const given = h("div", { class: "camera-given", hidden: true }, h("label", { class: "field", for: `${id}-text` }, "Model with parameters, or the content of a camera file", typed),
    h("button", { type: "button", onclick: () => file.click() }, "Choose a file"));
  const element = h("div", { class: "camera-choice" }, h("label", { class: "field", for: id }, text, select), given);
  return {
    element,
    get value() { return select.value === "none" ? null : select.value === "given" ? typed.value.trim() || null : select.value; },
    get complete() { return select.value !== "given" || typed.value.trim() !== ""; },
  };
}

/** The cameras of a pair: one for both images, or one each. */
export function pairOfCameras(changed) {
  const both = cameraChoice("camera", "Camera of both images", ["none", "exif", "estimate", "given"], changed);
  const far = cameraChoice("far-camera", "Camera of the far image", ["none", "exif", "given"], changed), near = cameraChoice("near-camera", "Camera of the near image", ["none", "exif", "given"], changed);
  const own = h("div", { class: "form-row", hidden: true }, far.element, near.element);
  const apart = h("input", { type: "checkbox", id: "cameras-apart", onchange: () => { own.hidden = !apart.checked; both.element.hidden = apart.checked; changed(); } });
  const element = h("details", { class: "more-options" }, h("summary", {}, "Cameras"),
    h("p", { class: "quiet small" }, "A known camera undoes the distortion of its lens. With the cameras of both images you can ask for the pose of the camera."),
    both.element, own, h("label", { class: "check", for: "cameras-apart" }, apart, "The images have different cameras"));
  const pair = () => (apart.checked ? [far.value, near.value] : [both.value, both.value]);
  return {
    element,
    get chosen() { const [far_camera, near_camera] = pair(); return { far_camera, near_camera }; },
    get both() { return pair().every(Boolean); },
  };
}
