/** The copies of images that were dropped on the page: what uses them, and their deletion. */

import { get, pictureAddress, remove } from "../api.js";
import { confirmed, fill, h, icon, iconButton, toast } from "../dom.js";

const MEGABYTE = 1e6;

export async function keptPage(main) {
  const { local } = await get("/api/about"), summary = h("p", { role: "status" }), list = h("div", {});
  const tidy = h("button", { type: "button", hidden: true, onclick: () => removeAll(unused) }, icon("trash"), "Delete those that nothing uses");
  let unused = [];
  const show = async () => {
    const images = await get("/api/uploads");
    unused = images.filter((image) => image.jobs + image.annotations === 0);
    tidy.hidden = unused.length === 0;
    summary.textContent = images.length ? `${images.length} ${images.length === 1 ? "image" : "images"}, ${megabytes(images)}` : "No image is kept.";
    fill(list, images.length > 0 && h("ul", { class: "rows" }, images.map(row)));
  };
  const row = (image) => h("li", {}, h("span", { class: "sent" },
    h("img", { src: pictureAddress(image.ref, true), alt: "", loading: "lazy" }),
    h("span", { class: "pair-name", title: image.name }, image.name), h("span", { class: "quiet" }, used(image)), h("span", { class: "quiet" }, megabytes([image]))),
  iconButton("trash", `Delete ${image.name}`, () => removeAll([image])));
  const removeAll = async (images) => {
    const [{ name }] = images, needed = images.filter((image) => image.jobs + image.annotations > 0);
    const title = images.length === 1 ? `Delete ${name}?` : `Delete ${images.length} images?`;
    const text = needed.length ? `It is used by ${used(needed[0])}. Their numbers stay, but the image cannot be shown with them any more.` : "Nothing uses it.";
    if (!(await confirmed(title, images.length === 1 ? text : "Nothing uses them.", "Delete"))) return;
    try {
      for (const image of images) await remove(`/api/uploads/${image.ref.split("/")[1]}`);
    } catch (error) {
      toast(error.message, "error");
    }
    await show();
    main.focus({ preventScroll: true });
  };
  fill(main, h("div", { class: "page-head" }, h("a", { class: "back", href: "#/localize" }, "Localize"), h("div", {}, h("h1", {}, "Images kept by this app"))),
    h("p", { class: "lead" }, "These are copies of images that were dropped on the page or chosen as files. ",
      local ? "They lie in a folder of this machine, and nothing leaves it. " : "They lie in a folder of the machine that runs nearfar app. ",
      "nearfar app prints this folder when it starts. Images of served folders are not copied."),
    summary, h("div", { class: "form-row filters" }, tidy), list);
  await show();
}

const counted = (number, word) => number > 0 && `${number} ${word}${number === 1 ? "" : "s"}`;

function used({ jobs, annotations }) {
  return [counted(jobs, "job"), counted(annotations, "annotation")].filter(Boolean).join(", ") || "not used";
}

function megabytes(images) {
  const size = images.reduce((sum, image) => sum + image.size, 0) / MEGABYTE;
  return size < 0.1 ? "under 0.1 MB" : `${size.toFixed(1)} MB`;
}
