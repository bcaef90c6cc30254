/** An image on a canvas that can be zoomed and panned by mouse, touch and keyboard. */

import { h } from "./dom.js";

const MOST_ENLARGED = 60;
const WHEEL = 0.0016;
const KEY_STEP = 60;
const CLICK_SLOP = 4;
const SMOOTH_UP_TO = 4;

/**
 * Events: "view" (the person moved it), "hover" (detail: point or null), "press" (detail: point).
 * Points are [x, y] in pixels of the original image.
 */
export class CanvasView extends EventTarget {
  /** @param {string} label what a screen reader calls it */
  constructor(label) {
    super();
    this.canvas = h("canvas", { tabindex: "0", role: "application", "aria-roledescription": "image view", "aria-label": label });
    this.message = h("p", { class: "canvas-message" });
    this.element = h("div", { class: "canvas-view" }, this.canvas, this.message);
    this.picture = null;
    this.tiles = null;
    this.size = [1, 1];
    this.scale = 1;
    this.origin = [0, 0];
    this.laid = [1, 1];
    this.layers = [];
    /** Takes hold of something under the pointer, if there is anything: {move, drop} or null. */
    this.grab = null;
    /** Uses a key that is pressed; returns whether it did. */
    this.useKey = () => false;
    this.pointers = new Map();
    this.pending = false;
    this.fitted = true;
    this.observer = new ResizeObserver(() => this.#resized());
    this.observer.observe(this.element);
    this.#listen();
  }

  /**
   * @param {HTMLImageElement|null} picture possibly reduced
   * @param {number[]} size of the original
   * @param {import("./tile-layer.js").TileLayer|null} tiles parts that show more than the picture
   */
  show(picture, size, tiles = null) {
    this.#drop();
    this.picture = picture;
    this.tiles = tiles;
    this.size = size;
    this.message.textContent = "";
    this.fit();
  }

  say(text) {
    this.#drop();
    this.picture = null;
    this.message.textContent = text;
    this.redraw();
  }

  #drop() {
    this.tiles?.close();
    this.tiles = null;
  }

  get width() { return this.element.clientWidth; }
  get height() { return this.element.clientHeight; }

  get fitScale() {
    return Math.min((this.width - 16) / this.size[0], (this.height - 16) / this.size[1]);
  }

  fit() {
    this.fitted = true;
    this.lookAt([(this.size[0] - 1) / 2, (this.size[1] - 1) / 2], this.fitScale);
    this.fitted = true;
  }

  /** Put a point of the image in the middle, at so many screen pixels a pixel. */
  lookAt(point, scale = this.scale) {
    this.scale = this.#limited(scale);
    this.laid = [this.width, this.height];
    this.origin = [this.width / 2 - point[0] * this.scale, this.height / 2 - point[1] * this.scale];
    this.fitted = false;
    this.redraw();
  }

  /** Show a box [left, top, right, bottom] of the image with some room around it. */
  lookAtBox([left, top, right, bottom], share = 0.8) {
    const scale = share * Math.min(this.width / (right - left), this.height / (bottom - top));
    this.lookAt([(left + right) / 2, (top + bottom) / 2], scale);
  }

  get centre() { return this.toImage([this.width / 2, this.height / 2]); }
  toImage([x, y]) { return [(x - this.origin[0]) / this.scale, (y - this.origin[1]) / this.scale]; }
  toScreen([x, y]) { return [x * this.scale + this.origin[0], y * this.scale + this.origin[1]]; }

  zoomBy(factor, at = [this.width / 2, this.height / 2]) {
    const point = this.toImage(at);
    this.scale = this.#limited(this.scale * factor);
    this.origin = [at[0] - point[0] * this.scale, at[1] - point[1] * this.scale];
    this.#moved();
  }

  panBy(x, y) {
    this.origin = [this.origin[0] + x, this.origin[1] + y];
    this.#moved();
  }

  redraw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => { this.pending = false; this.#draw(); });
  }

  #limited(scale) {
    const least = Math.min(1, Math.max(this.fitScale, 1e-4)) * 0.5;
    return Math.min(MOST_ENLARGED, Math.max(least, scale));
  }

  #moved() {
    // The middle of the view stays over the image.
    const [x, y] = this.centre, [width, height] = this.size;
    const held = [Math.min(width, Math.max(0, x)), Math.min(height, Math.max(0, y))];
    this.origin = [this.origin[0] + (x - held[0]) * this.scale, this.origin[1] + (y - held[1]) * this.scale];
    this.fitted = false;
    this.redraw();
    this.dispatchEvent(new Event("view"));
  }

  #resized() {
    const ratio = window.devicePixelRatio || 1;
    const centre = this.toImage([this.laid[0] / 2, this.laid[1] / 2]);
    this.canvas.width = Math.max(1, Math.round(this.width * ratio));
    this.canvas.height = Math.max(1, Math.round(this.height * ratio));
    if (this.fitted) this.fit();
    else this.lookAt(centre);
    this.redraw();
  }

  #draw() {
    const context = this.canvas.getContext("2d"), ratio = window.devicePixelRatio || 1;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    if (!this.picture) return;
    context.imageSmoothingEnabled = this.scale < SMOOTH_UP_TO;
    context.imageSmoothingQuality = "high";
    this.place(context, this.picture, [-0.5, -0.5, this.size[0] - 0.5, this.size[1] - 0.5]);
    if (this.tiles && this.scale > this.picture.naturalWidth / this.size[0]) this.tiles.draw(context, this);
    for (const layer of this.layers) {
      context.save();
      layer(context, this);
      context.restore();
    }
    const { scale, origin: [x, y] } = this;
    Object.assign(this.element.dataset, { scale, x, y });
    if (this.tiles) this.element.dataset.tiles = this.tiles.whole ? "whole" : "loading";
    this.dispatchEvent(new Event("drawn"));
  }

  /** Draw a picture over a box [left, top, right, bottom] of the image. */
  place(context, picture, [left, top, right, bottom]) {
    const [x, y] = this.toScreen([left, top]), [x2, y2] = this.toScreen([right, bottom]);
    context.drawImage(picture, x, y, x2 - x, y2 - y);
  }

  #at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  #listen() {
    const { canvas, pointers } = this;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 30 : 1;
      this.zoomBy(Math.exp(-event.deltaY * lines * WHEEL), this.#at(event));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, this.#at(event));
      this.travelled = pointers.size > 1 ? CLICK_SLOP + 1 : 0;
      this.holds = pointers.size === 1 && this.grab ? this.grab(this.#at(event), event) : null;
    });
    canvas.addEventListener("pointermove", (event) => {
      const at = this.#at(event), before = pointers.get(event.pointerId);
      this.dispatchEvent(new CustomEvent("hover", { detail: this.picture ? this.toImage(at) : null }));
      if (!before) return;
      this.travelled += Math.hypot(at[0] - before[0], at[1] - before[1]);
      if (this.holds && pointers.size === 1) this.holds.move(this.toImage(at), this.travelled);
      else if (pointers.size === 1) this.panBy(at[0] - before[0], at[1] - before[1]);
      else if (pointers.size === 2) this.#pinch(event.pointerId, before, at);
      pointers.set(event.pointerId, at);
    });
    const release = (event) => {
      if (!pointers.delete(event.pointerId)) return;
      if (this.holds) { this.holds.drop(); this.holds = null; }
      else if (event.type === "pointerup" && this.travelled <= CLICK_SLOP && this.picture) {
        this.dispatchEvent(new CustomEvent("press", { detail: this.toImage(this.#at(event)) }));
      }
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("pointerleave", () => this.dispatchEvent(new CustomEvent("hover", { detail: null })));
    canvas.addEventListener("dblclick", (event) => { if (!this.grab) this.zoomBy(2, this.#at(event)); });
    canvas.addEventListener("keydown", (event) => this.#key(event));
  }

  #pinch(moving, before, at) {
    const [other] = [...this.pointers].filter(([id]) => id !== moving).map(([, place]) => place);
    const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
    this.panBy((at[0] - before[0]) / 2, (at[1] - before[1]) / 2);
    this.zoomBy(apart(at) / Math.max(1, apart(before)), [(at[0] + other[0]) / 2, (at[1] + other[1]) / 2]);
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    if (this.useKey(event)) {
      event.preventDefault();
      event.stopPropagation();
      return;
    }
    const act = {
      ArrowLeft: () => this.panBy(KEY_STEP, 0),
      ArrowRight: () => this.panBy(-KEY_STEP, 0),
      ArrowUp: () => this.panBy(0, KEY_STEP),
      ArrowDown: () => this.panBy(0, -KEY_STEP),
      "+": () => this.zoomBy(1.4),
      "=": () => this.zoomBy(1.4),
      "-": () => this.zoomBy(1 / 1.4),
    }[event.key];
    if (!act) return;
    act();
    event.preventDefault();
    event.stopPropagation();
  }
}
