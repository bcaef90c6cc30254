/** A dialog to draw the areas of an image that must not be used: rectangles and polygons. */

import { CanvasView } from "./canvas-view.js";
import { dialog, h, iconButton } from "./dom.js";
import { distance } from "./geometry.js";
import { areas as drawAreas, cross, polygon, ring } from "./marks.js";
import { showImage } from "./show-image.js";

const CLOSE = 12, STEP = 8, FAST = 5;
const MOST_AREAS = 50, MOST_CORNERS = 200;
const HELP = {
  rectangle: "Drag across the image. Keyboard: arrow keys move the cross, Space sets a corner and then the one opposite.",
  polygon: "Click the corners; click the first again to close. Keyboard: arrow keys move the cross, Space sets a corner, Enter closes.",
};

/**
 * @param {{ref: string, name: string, width: number, height: number}} image
 * @param {number[][][]} areas polygons in pixels of the image
 * @returns {Promise<number[][][]|null>} the areas, or null where nothing is to change
 */
export function drawMask(image, areas) {
  return dialog(`Leave out parts of ${image.name}`, (close) => new MaskEditor(image, areas, close).element, "wide");
}

class MaskEditor {
  constructor(image, areas, close) {
    this.areas = areas.map((area) => area.map((corner) => [...corner]));
    this.draft = [];
    this.shape = "rectangle";
    this.size = [image.width, image.height];
    this.cursor = null;
    this.view = new CanvasView(`Mask of ${image.name}: draw what must not be used`);
    this.view.layers.push((context, view) => this.#draw(context, view));
    this.view.grab = (at) => (this.shape === "rectangle" ? this.#rectangle(this.view.toImage(at)) : null);
    this.view.useKey = (event) => this.#key(event);
    this.view.addEventListener("press", (event) => this.shape === "polygon" && this.#corner(event.detail));
    this.help = h("p", { class: "quiet small", id: "mask-help" });
    this.count = h("span", { class: "quiet", role: "status" });
    this.element = h("div", { class: "dialog-body mask-editor" },
      h("div", { class: "toolbar" },
        h("div", { class: "segmented", role: "radiogroup", "aria-label": "Shape" }, ["rectangle", "polygon"].map((shape) =>
          h("button", { type: "button", role: "radio", dataset: { shape }, onclick: () => this.#choose(shape) }, shape === "rectangle" ? "Rectangle" : "Polygon"))),
        this.count,
        h("div", { class: "tools" },
          iconButton("undo", "Take back the last corner or area (Backspace)", () => this.#undo()),
          iconButton("trash", "Remove all areas", () => this.#clear()))),
      this.view.element, this.help,
      h("footer", {},
        h("button", { type: "button", onclick: () => close(null) }, "Cancel"),
        h("button", { type: "button", class: "primary", id: "mask-done", onclick: () => close(this.areas) }, "Use mask")));
    this.#choose("rectangle");
    this.view.say("Loading…");
    showImage(this.view, image.ref).then(() => {
      this.view.canvas.focus();
      this.element.dataset.ready = "true";
    }, (error) => this.view.say(error.message));
  }

  #choose(shape) {
    this.shape = shape;
    this.draft = [];
    this.help.textContent = HELP[shape];
    for (const button of this.element.querySelectorAll("[data-shape]")) button.setAttribute("aria-checked", String(button.dataset.shape === shape));
    this.#changed();
  }

  #inside([x, y]) {
    const [width, height] = this.size;
    return [Math.min(width - 0.5, Math.max(-0.5, x)), Math.min(height - 0.5, Math.max(-0.5, y))];
  }

  #rectangle(start) {
    const first = this.#inside(start);
    return {
      move: (point) => { this.draft = rectangle(first, this.#inside(point)); this.#changed(); },
      drop: () => { const [a, , c] = this.draft; if (c && Math.abs(a[0] - c[0]) >= 1 && Math.abs(a[1] - c[1]) >= 1) this.#close(); else this.#undo(); },
    };
  }

  #corner(point) {
    const near = this.draft.length > 2 && distance(this.view.toScreen(this.draft[0]), this.view.toScreen(point)) < CLOSE;
    if (near) this.#close();
    else if (this.draft.length < MOST_CORNERS) this.draft.push(this.#inside(point));
    this.#changed();
  }

  #close() {
    if (this.draft.length > 2 && this.areas.length < MOST_AREAS) this.areas.push(this.draft);
    this.draft = [];
    this.#changed();
  }

  #undo() {
    if (this.draft.length && this.shape === "polygon") this.draft.pop();
    else if (this.draft.length) this.draft = [];
    else this.areas.pop();
    this.#changed();
  }

  #clear() {
    this.areas = [];
    this.draft = [];
    this.#changed();
  }

  #changed() {
    const number = this.areas.length;
    this.count.textContent = number === 1 ? "1 area left out" : `${number} areas left out`;
    this.view.redraw();
  }

  #key(event) {
    const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (move) {
      const step = (STEP * (event.shiftKey ? FAST : 1)) / this.view.scale;
      const [x, y] = this.cursor ?? this.view.centre;
      this.cursor = this.#inside([x + step * move[0], y + step * move[1]]);
      if (this.shape === "rectangle" && this.first) this.draft = rectangle(this.first, this.cursor);
    } else if (event.key === " ") this.#set(this.cursor ?? this.view.centre);
    else if (event.key === "Enter") this.#close();
    else if (event.key === "Backspace") { this.first = null; this.#undo(); }
    else return false;
    this.#changed();
    return true;
  }

  /** Set a corner by keyboard. */
  #set(point) {
    this.cursor = point;
    if (this.shape === "polygon") { this.#corner(point); return; }
    if (!this.first) { this.first = this.#inside(point); return; }
    this.draft = rectangle(this.first, this.#inside(point));
    this.first = null;
    this.#close();
  }

  #draw(context, view) {
    drawAreas(context, view, this.areas);
    if (this.draft.length > 1) polygon(context, view, this.draft, "#ffffff", 1.5);
    for (const corner of this.draft) ring(context, view, corner, "#ffffff", 4, 1.5);
    if (this.first) ring(context, view, this.first, "#ffffff", 4, 1.5);
    if (this.cursor) cross(context, view, this.cursor, "#ffffff");
  }
}

function rectangle([x, y], [x2, y2]) {
  return [[x, y], [x2, y], [x2, y2], [x, y2]];
}
