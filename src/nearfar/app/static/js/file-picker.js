/** A dialog to choose an image, a map or results from the folders that are served. */

import { get, imageInfo, pictureAddress } from "./api.js";
import { append, dialog, fill, h, icon } from "./dom.js";

/** @returns {Promise<{ref: string, name: string}|null>} an image */
export function pickImage(title) {
  return pick(title, "image");
}

/** @returns {Promise<{ref: string, name: string}|null>} any folder */
export function pickFolder(title) {
  return pick(title, "folder");
}

/** @returns {Promise<{ref: string, name: string}|null>} a folder of frames, or a video */
export function pickFrames(title) {
  return pick(title, "frames");
}

const FOLDER_ICONS = { map: "map", run: "table", track: "route", folder: "folder" };
const LAST = { image: "", folder: "", frames: "" };

function pick(title, wanted) {
  return dialog(title, (close) => {
    const trail = h("nav", { class: "trail", "aria-label": "Folder" });
    const list = h("div", { class: "file-list", tabindex: "0", role: "region", "aria-label": "Files" });
    const filter = h("input", { type: "search", placeholder: "Part of a name", "aria-label": "Show names that hold", oninput: () => later() });
    const choose = h("button", { type: "button", class: "primary", disabled: true }, "Choose this folder");
    let current = "", asked = 0, timer = 0;
    const later = () => { clearTimeout(timer); timer = setTimeout(() => open(current, { focus: false }), 200); };
    const open = async (ref, { focus = true, start = 0 } = {}) => {
      const number = ++asked;
      if (ref !== current) filter.value = "";
      current = ref;
      if (!start) fill(list, h("p", { class: "quiet", role: "status" }, "Loading…"));
      try {
        const listing = await get("/api/folders", ref ? { ref, text: filter.value, start, videos: wanted === "frames" } : {});
        if (number !== asked) return;
        show(listing, focus);
        LAST[wanted] = ref;
      } catch (error) {
        if (number !== asked) return;
        if (ref) open("");
        else fill(list, h("p", { class: "quiet" }, error.message));
      }
    };
    const show = (listing, focus) => {
      const top = { ref: "", name: "Folders" };
      fill(trail, [top, ...listing.parents].map((each, i, all) => [
        i > 0 && h("span", { "aria-hidden": "true" }, "/"),
        h("button", { type: "button", class: "link", "aria-current": i === all.length - 1 ? "location" : null, onclick: () => open(each.ref) }, each.name)]));
      filter.hidden = !listing.ref;
      choose.disabled = !listing.ref;
      choose.onclick = () => close({ ref: listing.ref, name: listing.parents.at(-1).name });
      const folders = listing.folders.map((each) => h("button", { type: "button", class: "file folder", onclick: () => open(each.ref) },
        icon(FOLDER_ICONS[each.kind]), h("span", {}, each.name)));
      const videos = listing.videos.map((each) => h("button", { type: "button", class: "file folder", onclick: () => close(each) }, icon("play"), h("span", {}, each.name)));
      const images = wanted !== "image" ? [] : listing.images.map((each) => imageButton(each, close));
      const shown = listing.start + listing.folders.length + listing.images.length + listing.videos.length;
      const parts = [h("div", { class: "files folders" }, folders, videos), h("div", { class: "files images" }, images),
        wanted === "frames" && listing.images.length > 0 && h("p", { class: "quiet", role: "status" }, `${listing.total - listing.folders.length - listing.videos.length} images are in this folder.`),
        shown < listing.total && h("button", { type: "button", class: "more", onclick: () => open(listing.ref, { start: shown }) }, `Show more of ${listing.total}`)];
      if (listing.start) {
        list.querySelector(".more")?.remove();
        append(list, parts);
        images[0]?.focus();
        return;
      }
      if (folders.length + videos.length + listing.images.length === 0) fill(list, h("p", { class: "quiet", role: "status" }, emptyText(listing, filter.value)));
      else fill(list, parts);
      if (focus) list.querySelector("button")?.focus();
    };
    open(LAST[wanted]);
    return h("div", { class: "dialog-body picker" }, trail, filter, list, wanted !== "image" && h("footer", {}, choose));
  }, "wide");
}

/** A button with a thumbnail, or with the reason why there is none. */
function imageButton(image, close) {
  const picture = h("img", { loading: "lazy", alt: "", src: pictureAddress(image.ref, true), onerror: async () => {
    const problem = h("span", { class: "problem small" }, "cannot be shown");
    picture.replaceWith(problem);
    problem.textContent = await imageInfo(image.ref).then(() => "The picture could not be loaded.", (error) => error.message);
  } });
  return h("button", { type: "button", class: "file", onclick: () => close(image) }, picture, h("span", {}, image.name));
}

function emptyText(listing, text) {
  if (text) return `No name holds “${text}”.`;
  return listing.ref ? "There is nothing to open in this folder."
    : "nearfar app was started without folders. Drop images on the page instead, or start it as: nearfar app FOLDER";
}
