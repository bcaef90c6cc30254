/** A map without tiles from the network: outlines of images and answers, a scale bar, and coordinates. */

import { loadPicture, pictureAddress } from "./api.js";
import { CanvasView } from "./canvas-view.js";
import { h, iconButton } from "./dom.js";
import { bounds } from "./geometry.js";
import { COLOURS, dots, label, polygon } from "./marks.js";
import { Plane } from "./world-plane.js";

const MOST_PICTURES = 60, BAR = 140;
const KINDS = [["answer", "Answers"], ["image", "Images"], ["position", "Camera positions"], ["picture", "Pictures"]];
const COLOUR = { answer: COLOURS.outline, image: COLOURS.suggestion, position: COLOURS.landmark };

export class WorldMap {
  /** @param {{system: string, features: {kind: string, name: string, ref: string|null, outline: number[][]}[]}} world */
  constructor(world) {
    this.plane = new Plane(world.system, world.features.flatMap((feature) => feature.outline));
    this.features = world.features.map((feature) => ({ ...feature, points: feature.outline.map((point) => this.plane.fromWorld(point)), picture: null }));
    this.shown = Object.fromEntries(KINDS.map(([kind]) => [kind, true]));
    this.chosen = null;
    this.view = new CanvasView("Map: arrow keys move it, plus and minus zoom");
    this.view.layers.push((context, view) => this.#draw(context, view));
    this.pointer = h("span", { class: "pointer-place" });
    this.view.addEventListener("hover", (event) => this.#tell(event.detail));
    this.view.addEventListener("drawn", () => this.at || this.#tell(null));
    const there = new Set(this.features.map((each) => each.kind));
    if (this.features.some((each) => each.ref && each.kind === "image")) there.add("picture");
    this.element = h("section", { class: "viewer world", "aria-label": "Map" },
      h("div", { class: "toolbar", role: "toolbar", "aria-label": "What the map shows" },
        h("div", { class: "checks" }, KINDS.filter(([kind]) => there.has(kind)).map(([kind, text]) => h("label", { class: "check" },
          h("input", { type: "checkbox", checked: true, dataset: { layer: kind }, onchange: (event) => { this.shown[kind] = event.target.checked; this.view.redraw(); } }),
          kind !== "picture" && h("i", { class: `swatch world-${kind}` }), text))),
        h("div", { class: "tools" },
          iconButton("fit", "Show everything (f)", () => this.view.fit()),
          iconButton("minus", "Zoom out", () => this.view.zoomBy(1 / 1.5)),
          iconButton("plus", "Zoom in", () => this.view.zoomBy(1.5)))),
      h("div", { class: "world-stage" }, this.view.element), h("p", { class: "world-foot quiet small" }, this.pointer, h("span", {}, "North is up. ", this.plane.degrees ? "WGS 84." : `${this.plane.system}.`)));
    const blank = new Image(1, 1);
    blank.src = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7";
    this.ready = blank.decode().then(() => { this.view.show(blank, this.plane.size); this.#loadPictures(); });
  }

  get shortcuts() {
    return [{ key: "f", label: "f", what: "show everything", act: () => this.view.fit() }];
  }

  /** Show one of the features large. */
  zoomTo(index) {
    this.chosen = index;
    const [left, top, right, bottom] = bounds(this.features[index].points);
    const room = Math.max(10, (right - left) * 0.2, (bottom - top) * 0.2);
    this.view.lookAtBox([left - room, top - room, right + room, bottom + room]);
  }

  async #loadPictures() {
    for (const feature of this.features.filter((each) => each.kind === "image" && each.ref && each.points.length === 4).slice(0, MOST_PICTURES)) {
      try {
        feature.picture = await loadPicture(pictureAddress(feature.ref, true));
      } catch {
        continue;  // The outline is there.
      }
      this.view.redraw();
    }
    this.element.dataset.ready = "true";
  }

  #tell(point) {
    this.at = point;
    this.pointer.textContent = `${point ? "Under the pointer" : "In the middle"}: ${this.plane.words(point ?? this.view.centre)}`;
  }

  #draw(context, view) {
    if (this.shown.picture) for (const feature of this.features) if (feature.picture) this.#drawPicture(context, view, feature);
    for (const kind of ["image", "position", "answer"]) {
      if (!this.shown[kind]) continue;
      this.features.forEach((feature, i) => {
        if (feature.kind !== kind) return;
        const lit = i === this.chosen;
        if (feature.points.length === 1) dots(context, view, feature.points, COLOUR[kind], lit ? 7 : 4.5);
        else polygon(context, view, feature.points, COLOUR[kind], lit ? 4 : kind === "answer" ? 2.5 : 1.5);
        if (lit) label(context, view, feature.points[0], feature.name);
      });
    }
    this.#drawScale(context, view);
  }

  /** A thumbnail, by three corners of its outline. */
  #drawPicture(context, view, { picture, points }) {
    const [a, b, , d] = points.map((point) => view.toScreen(point));
    const { naturalWidth: width, naturalHeight: height } = picture;
    context.save();
    context.transform((b[0] - a[0]) / width, (b[1] - a[1]) / width, (d[0] - a[0]) / height, (d[1] - a[1]) / height, a[0], a[1]);
    context.drawImage(picture, 0, 0);
    context.restore();
  }

  #drawScale(context, view) {
    const [units, text] = this.plane.scaleBar(BAR / view.scale), length = units * view.scale;
    const [x, y] = [14, view.height - 14];
    for (const [colour, width] of [["rgba(0, 0, 0, 0.75)", 5], ["#fff", 2]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      context.moveTo(x, y - 6);
      context.lineTo(x, y);
      context.lineTo(x + length, y);
      context.lineTo(x + length, y - 6);
      context.stroke();
    }
    label(context, { toScreen: (point) => point }, [x - 4, y - 4], text);
    this.element.dataset.scale = text;
  }
}
