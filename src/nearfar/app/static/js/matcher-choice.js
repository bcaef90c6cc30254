/** The choice of a matcher and of the device that it runs on. */

import { h } from "./dom.js";

const NAMES = {
  sift: "SIFT alone",
  "aliked-lightglue": "ALIKED + LightGlue",
  "aliked-lightglue-onnx": "ALIKED + LightGlue (ONNX)",
  "disk-lightglue": "DISK + LightGlue",
  xfeat: "XFeat",
  "xfeat-lighterglue": "XFeat + LighterGlue",
};
const DEVICES = { auto: "GPU where there is one", cpu: "Processor", cuda: "NVIDIA GPU", mps: "Apple GPU" };

/**
 * @param {{name: string, missing: string|null}[]} matchers
 * @param {string[]} devices
 * @returns {{element: HTMLElement, chosen: {matcher: string, device: string}}}
 */
export function matcherChoice(matchers, devices) {
  const nameOf = (each) => NAMES[each.name] ?? each.name, missing = matchers.filter((each) => each.missing);
  const matcher = h("select", { id: "matcher", onchange: () => { device.disabled = matcher.value === "sift"; } },
    matchers.map((each) => h("option", { value: each.name, disabled: Boolean(each.missing) }, nameOf(each) + (each.missing ? " (not installed)" : ""))));
  const device = h("select", { id: "device", disabled: true }, devices.map((each) => h("option", { value: each }, DEVICES[each] ?? each)));
  const element = h("details", { class: "more-options" }, h("summary", {}, "Learned matchers"),
    h("p", { class: "quiet small" }, "SIFT always begins. A learned matcher goes on where SIFT is not enough, as under other light."),
    h("div", { class: "form-row" }, h("label", { class: "field", for: "matcher" }, "Matcher", matcher), h("label", { class: "field", for: "device" }, "Runs on", device)),
    missing.length > 0 && h("dl", { class: "missing" }, missing.map((each) => h("div", {}, h("dt", {}, nameOf(each)), h("dd", { class: "quiet small" }, each.missing)))));
  return { element, get chosen() { return { matcher: matcher.value, device: device.value }; } };
}
