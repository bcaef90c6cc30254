/** A dialog to choose an image, a map or results from the folders that are served. */

import { get, pictureAddress } from "./api.js";
import { dialog, fill, h, icon } from "./dom.js";

/** @returns {Promise<{ref: string, name: string}|null>} an image */
export function pickImage(title) {
  return pick(title, "image");
}

/** @returns {Promise<{ref: string, name: string}|null>} any folder */
export function pickFolder(title) {
  return pick(title, "folder");
}

const LAST = { image: "", folder: "" };

function pick(title, wanted) {
  return dialog(title, (close) => {
    const trail = h("nav", { class: "trail", "aria-label": "Folder" });
    const list = h("div", { class: "file-list" });
    const choose = h("button", { type: "button", class: "primary", disabled: true }, "Choose this folder");
    const open = async (ref) => {
      fill(list, h("p", { class: "quiet" }, "Loading…"));
      try {
        show(await get("/api/folders", ref ? { ref } : {}));
        LAST[wanted] = ref;
      } catch (error) {
        if (ref) open("");
        else fill(list, h("p", { class: "quiet" }, error.message));
      }
    };
    const show = (listing) => {
      const top = { ref: "", name: "Folders" };
      fill(trail, [top, ...listing.parents].map((each, i, all) => [
        i > 0 && h("span", { "aria-hidden": "true" }, "/"),
        h("button", { type: "button", class: "link", "aria-current": i === all.length - 1 ? "location" : null, onclick: () => open(each.ref) }, each.name)]));
      choose.disabled = !listing.ref;
      choose.onclick = () => close({ ref: listing.ref, name: listing.parents.at(-1).name });
      const folders = listing.folders.map((each) => h("button", { type: "button", class: "file folder", onclick: () => open(each.ref) },
        icon(each.kind === "map" ? "map" : each.kind === "run" ? "table" : "folder"), h("span", {}, each.name)));
      const images = wanted === "image" ? listing.images.map((each) => h("button", { type: "button", class: "file", onclick: () => close(each) },
        h("img", { src: pictureAddress(each.ref, true), alt: "", loading: "lazy" }), h("span", {}, each.name))) : [];
      if (folders.length + images.length === 0) fill(list, h("p", { class: "quiet" }, emptyText(listing)));
      else fill(list, h("div", { class: "files folders" }, folders), h("div", { class: "files images" }, images),
        !listing.complete && h("p", { class: "quiet" }, "There are more; only the first are listed."));
      list.querySelector("button")?.focus();
    };
    open(LAST[wanted]);
    return h("div", { class: "dialog-body picker" }, trail, list, wanted === "folder" && h("footer", {}, choose));
  }, "wide");
}

function emptyText(listing) {
  return listing.ref ? "There is nothing to open in this folder."
    : "nearfar app was started without folders. Drop images on the page instead, or start it as: nearfar app FOLDER";
}
