/** A place for one image: dropped, chosen from the disk, pasted, or picked from a served folder. */

import { imageInfo, pictureAddress, sendImage } from "./api.js";
import { fill, h, icon, iconButton } from "./dom.js";
import { pickImage } from "./file-picker.js";
import { drawMask } from "./mask-editor.js";

export class ImageSlot extends EventTarget {
  /** @param {string} title @param {string} hint @param {boolean} masks whether parts can be left out */
  constructor(title, hint, masks = false) {
    super();
    this.masks = masks;
    this.areas = [];
    this.title = title;
    this.hint = hint;
    this.image = null;
    this.input = h("input", { type: "file", accept: "image/*,.tif,.tiff,.ppm,.pgm,.jp2,.avif,.heic,.heif", class: "visually-hidden", tabindex: "-1", "aria-label": `${title}: choose a file`,
      onchange: () => this.input.files[0] && this.take(this.input.files[0]) });
    this.body = h("div", { class: "slot-body" });
    this.element = h("section", { class: "slot", "aria-label": title }, this.body, this.input);
    for (const type of ["dragenter", "dragover"]) {
      this.element.addEventListener(type, (event) => { event.preventDefault(); this.element.classList.add("over"); });
    }
    for (const type of ["dragleave", "drop"]) this.element.addEventListener(type, () => this.element.classList.remove("over"));
    this.element.addEventListener("drop", (event) => {
      event.preventDefault();
      const [file] = event.dataTransfer.files;
      if (file) this.take(file);
    });
    this.#empty();
  }

  /** Give a file to the server and show it. */
  async take(file) {
    this.#busy(`Opening ${file.name}…`);
    try {
      this.set(await sendImage(file));
    } catch (error) {
      this.#empty(error.message);
    }
  }

  /** Show an image of the server. */
  async setRef(ref, name = "the image") {
    this.#busy(`Reading ${name}…`);
    try {
      this.set(await imageInfo(ref));
    } catch (error) {
      this.#empty(error.message);
    }
  }

  /** @param {number[][][]} areas that are left out of it, polygons */
  set(image, areas = []) {
    this.image = image;
    this.areas = areas;
    if (!image) this.#empty();
    else fill(this.body,
      h("img", { src: pictureAddress(image.ref), alt: `${this.title}: ${image.name}` }),
      h("div", { class: "slot-caption" },
        h("div", {}, h("b", {}, this.title), h("span", { class: "quiet", title: image.name }, `${image.name} · ${image.width} × ${image.height}`)),
        this.masks && h("button", { type: "button", class: "small", "aria-label": `Mask of the ${this.title.toLowerCase()}`, onclick: () => this.#mask() },
          areas.length ? `Mask (${areas.length})` : "Mask…"),
        iconButton("close", `Remove the ${this.title.toLowerCase()}`, () => this.set(null))));
    this.dispatchEvent(new Event("change"));
  }

  #busy(text) {
    fill(this.body, h("div", { class: "slot-empty busy" }, h("span", { class: "spinner" }), h("p", { role: "status" }, text)));
  }

  async #mask() {
    const drawn = await drawMask(this.image, this.areas);
    if (drawn) this.set(this.image, drawn);
  }

  async #pick() {
    const chosen = await pickImage(this.title);
    if (chosen) this.setRef(chosen.ref, chosen.name);
  }

  #empty(problem = "") {
    const had = this.image;
    this.image = null;
    this.areas = [];
    this.input.value = "";
    fill(this.body, h("div", { class: "slot-empty" },
      icon("image"), h("h2", {}, this.title), h("p", { class: "quiet" }, this.hint),
      problem && h("p", { class: "problem", role: "alert" }, problem),
      h("div", { class: "slot-actions" },
        h("button", { type: "button", onclick: () => this.input.click() }, "Choose a file"),
        h("button", { type: "button", onclick: () => this.#pick() }, "From a folder")),
      h("p", { class: "quiet small" }, "or drop it here")));
    if (had) this.dispatchEvent(new Event("change"));
  }
}
