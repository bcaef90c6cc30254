/** "Export as …": the formats of an answer; below, those that it cannot be written in, and why. */

import { get, save } from "./api.js";
import { dialog, fill, h, icon, toast } from "./dom.js";
import { formatName } from "./wording.js";

/**
 * @param {string} path of the answer, below which are `exports` and `export`
 * @param {Object<string, string|number>} query that tells which answer
 * @param {string} text of the button
 * @param {(format: string) => string} nameOf what a format is called
 */
export function exportButton(path, query = {}, text = "Export as …", nameOf = formatName) {
  return h("button", { type: "button", id: "export", "aria-haspopup": "dialog", onclick: () => choose(path, query, nameOf) }, icon("download"), text);
}

function choose(path, query, nameOf) {
  return dialog("Export as …", (close) => {
    const list = h("fieldset", { class: "formats", "aria-label": "Formats" }, h("p", { class: "quiet" }, "Loading…"));
    const go = h("button", { type: "submit", class: "primary", disabled: true }, "Download");
    const chosen = () => [...list.querySelectorAll("input:checked")].map((each) => each.value);
    const download = async () => {
      go.disabled = true;
      try {
        await save(`${path}/export`, [...Object.entries(query), ...chosen().map((name) => ["format", name])]);
        close();
      } catch (error) {
        toast(error.message, "error");
        go.disabled = false;
      }
    };
    get(`${path}/exports`, query).then((formats) => {
      const refused = formats.filter((each) => each.reason !== null);
      fill(list, formats.filter((each) => each.reason === null).map((each) => choice(each, nameOf)),
        refused.length > 0 && h("h3", {}, "Not possible here"), refused.map((each) => choice(each, nameOf)));
      list.querySelector("input:enabled")?.focus();
    }, (error) => fill(list, h("p", { class: "problem", role: "alert" }, error.message)));
    list.addEventListener("change", () => {
      const { length } = chosen();
      go.disabled = length === 0;
      go.textContent = length > 1 ? `Download ${length} as ZIP` : "Download";
    });
    return h("form", { class: "dialog-body", onsubmit: (event) => { event.preventDefault(); download(); } }, list, h("footer", {}, go));
  });
}

function choice({ format, file, reason }, nameOf) {
  const why = reason && h("span", { class: "quiet small", id: `why-not-${format}` }, reason);
  return h("label", { class: "choice", title: reason },
    h("input", { type: "checkbox", value: format, disabled: reason !== null, "aria-describedby": why && why.id }),
    h("span", {}, nameOf(format), " ", h("span", { class: "quiet small" }, file), why));
}
