/** Ways out of an annotation: files to download, or a pair in a benchmark folder. */

import { post } from "./api.js";
import { confirmed, fill, h, icon, toast } from "./dom.js";
import { pickFolder } from "./file-picker.js";

const LEAST = { homography: 4, fundamental: 1 };
const LAYOUTS = [
  ["pair.json", "pair.json", "The points alone"],
  ["pair", "Pair with images", "A folder that nearfar bench pairs reads"],
  ["paper", "The paper's layout", "1.png, 2.png and 1_to_2.yaml"],
];

/** @param {import("./annotation-state.js").AnnotationState} state */
export function exportPanel(state) {
  const element = h("section", { class: "export" });
  const draw = () => {
    const missing = Math.max(0, LEAST[state.annotation.model] - state.marked);
    fill(element, h("h2", {}, "Export"),
      missing > 0 ? h("p", { class: "quiet small" }, `Mark ${missing} more ${missing === 1 ? "point" : "points"} first.`) : [
        h("button", { type: "button", class: "primary", id: "add-to-benchmark", onclick: () => add(state) }, icon("folder"), "Add to a benchmark folder"),
        h("ul", { class: "downloads" }, LAYOUTS.map(([layout, text, what]) => h("li", {},
          h("button", { type: "button", class: "link", dataset: { layout }, onclick: () => download(state, layout) }, text), h("span", { class: "quiet small" }, what)))),
      ]);
  };
  let last = "";
  state.addEventListener("change", () => {
    const key = `${state.annotation.model} ${Math.min(state.marked, 4)}`;
    if (key !== last) draw();
    last = key;
  });
  draw();
  return element;
}

async function download(state, layout) {
  await state.save();
  const address = `/api/annotations/${state.annotation.id}/export?layout=${layout}`;
  const link = h("a", { href: address, download: "" });
  document.body.append(link);
  link.click();
  link.remove();
}

async function add(state) {
  await state.save();
  const folder = await pickFolder("Add to a benchmark folder");
  if (!folder) return;
  const send = (replace) => post(`/api/annotations/${state.annotation.id}/add`, { folder: folder.ref, replace });
  try {
    toast(`Written: ${(await send(false)).name}`, "good");
  } catch (error) {
    if (error.status !== 409 || !/already/.test(error.message)) {
      toast(error.message, "error");
    } else if (await confirmed("Replace this pair?", error.message, "Replace")) {
      await send(true).then((written) => toast(`Written: ${written.name}`, "good"), (failure) => toast(failure.message, "error"));
    }
  }
}
