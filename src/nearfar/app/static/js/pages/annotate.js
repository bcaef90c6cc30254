/** Annotations: the list of them, and a new one. */

import { get, post, remove } from "../api.js";
import { AnnotationEditor } from "../annotation-editor.js";
import { confirmed, fill, formatTime, h, iconButton, toast } from "../dom.js";
import { keptNote } from "../kept-note.js";
import { pairOfSlots } from "./localize.js";
import { setShortcuts } from "../shortcuts.js";

export async function annotatePage(main, [id], signal) {
  if (!id) {
    await start(main);
    return;
  }
  const opened = await get(`/api/annotations/${id}`);
  if (signal.aborted) return;
  const editor = new AnnotationEditor(opened);
  fill(main, editor.element);
  setShortcuts("Annotation", editor.shortcuts);
  signal.addEventListener("abort", () => editor.leave());
  // The browser then asks before it closes the page.
  window.addEventListener("beforeunload", (event) => { if (!editor.state.kept) event.preventDefault(); }, { signal });
  await editor.load();
}

async function start(main) {
  const about = await get("/api/about"), slots = pairOfSlots();
  const go = h("button", { type: "button", class: "primary large", disabled: true, id: "annotate", onclick: () => submit() }, "Mark points");
  const submit = async () => {
    if (go.disabled) return;
    try {
      const opened = await post("/api/annotations", { far: slots.far.image.ref, near: slots.near.image.ref });
      location.hash = `#/annotate/${opened.annotation.id}`;
    } catch (error) {
      toast(error.message, "error");
    }
  };
  slots.onChange(() => { go.disabled = !slots.complete; });
  setShortcuts("Annotate", [
    { key: "Enter", label: "Enter", what: "mark points", act: submit },
    { key: "x", label: "x", what: "swap far and near", act: slots.swap },
  ]);
  const list = h("section", { class: "recent" });
  fill(main, h("div", { class: "intro" }, h("h1", {}, "Mark the truth by hand"),
    h("p", { class: "lead" }, "Click the same ten places in both images. What you mark becomes a pair of a benchmark, as in the paper.")),
  slots.element, h("div", { class: "form-row end" }, go), keptNote(about), list);
  showList(list);
}

async function showList(element) {
  const annotations = await get("/api/annotations");
  fill(element);
  if (!annotations.length) return;
  fill(element, h("h2", {}, "Annotations"), h("ul", { class: "rows" }, annotations.map((each) => {
    const marked = each.points.filter((pair) => pair.far && pair.near).length;
    return h("li", {}, h("a", { href: `#/annotate/${each.id}` },
      h("span", { class: "pair-name" }, each.name, h("span", { class: "quiet" }, ` ${each.near_name} in ${each.far_name}`)),
      h("span", { class: `badge ${marked >= 10 ? "good" : "quiet"}` }, `${marked} of 10`), h("time", { class: "quiet" }, formatTime(each.changed))),
    iconButton("trash", `Delete ${each.name}`, async () => {
      if (await confirmed(`Delete ${each.name}?`, `Its ${marked} points are deleted. What was exported stays.`, "Delete")) {
        await remove(`/api/annotations/${each.id}`);
        showList(element);
      }
    }));
  })));
}
