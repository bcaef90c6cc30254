/** The far and the near image with what was found: side by side, blended, or under a swipe. */

import { CanvasView } from "./canvas-view.js";
import { Divider } from "./divider.js";
import { h, iconButton, refill } from "./dom.js";
import { drawEpipolarLines, epipolarError } from "./epipolar.js";
import { bounds, distance, footprint, transform } from "./geometry.js";
import { Linked } from "./linked.js";
import { COLOURS, areas, box, cross, dots, polygon, ring, topEdge, unverified } from "./marks.js";
import { MatchCard } from "./match-card.js";
import { drawMatchLines } from "./match-lines.js";
import { warpedOverlay } from "./overlay.js";
import { showImage } from "./show-image.js";
import { stepName } from "./wording.js";

const NEAREST = 14;
const MODES = [["side", "Side by side"], ["blend", "Blend"], ["swipe", "Swipe"]];

/** Dots as large as their distance from each other allows. */
function dotRadius(view, points) {
  const [left, top, right, bottom] = bounds(points);
  const apart = Math.sqrt(((right - left) * (bottom - top)) / points.length) * view.scale;
  return Math.min(3, Math.max(1.1, apart * 0.2));
}

/**
 * @typedef {object} PairData
 * @property {string} far reference
 * @property {string} near reference
 * @property {number[][]|null} homography maps near to far pixels
 * @property {{name: string, far: number[][], near: number[][], inliers: number[], answer: boolean}[]} steps
 * @property {{far: number[], near: number[], similarity: number}[]} landmarks
 * @property {number|null} scaleChange
 * @property {{far: number[][][], near: number[][][]}} [masks] areas that were left out
 * @property {number[][][]} [candidates] homographies of other places, which nothing confirms
 * @property {number[][]|null} [fundamental] matrix F of an epipolar geometry: far·F·near = 0
 */
export class PairViewer {
  constructor() {
    this.far = new CanvasView("Far image");
    this.near = new CanvasView("Near image");
    this.linked = new Linked(this.far, this.near);
    this.card = new MatchCard();
    this.lines = h("canvas", { class: "lines", "aria-hidden": "true" });
    this.farPane = h("figure", { class: "pane" }, h("figcaption", {}, h("b", {}, "Far"), this.farName = h("span", {})), this.far.element);
    this.nearPane = h("figure", { class: "pane" }, h("figcaption", {}, h("b", {}, "Near"), this.nearName = h("span", {})), this.near.element);
    this.divider = new Divider(this.far.element, () => this.far.redraw());
    this.stage = h("div", { class: "stage" }, this.farPane, this.nearPane, this.lines, this.card.element);
    this.toolbar = h("div", { class: "toolbar", role: "toolbar", "aria-label": "How the images are shown" });
    this.element = h("section", { class: "viewer", "aria-label": "Image viewer" }, this.toolbar, this.stage);
    this.mode = "side";
    this.state = { epipolar: true, outline: true, agrees: true, differs: false, landmarks: false, lines: false };
    this.opacity = 60;
    this.step = null;
    this.highlight = null;
    this.candidates = [];
    this.chosenCandidate = null;
    this.far.layers.push((context, view) => this.#drawFar(context, view));
    this.near.layers.push((context, view) => this.#drawNear(context, view));
    for (const view of [this.far, this.near]) {
      view.addEventListener("hover", (event) => this.#hover(view, event.detail));
      view.addEventListener("drawn", () => this.#drawLines());
    }
  }

  /** @param {PairData} data */
  async show(data) {
    this.data = data;
    this.overlay = null;
    this.farFootprint = null;
    this.candidates = [];
    this.chosenCandidate = null;
    this.step = data.steps.find((each) => each.answer)?.name ?? data.steps[0]?.name ?? null;
    if (!data.homography && data.steps.length) this.state.differs = true;
    this.far.say("Loading…");
    this.near.say("Loading…");
    this.#buildToolbar();
    const sizes = await Promise.all([this.#load(this.far, data.far, this.farName), this.#load(this.near, data.near, this.nearName)]);
    if (this.data !== data) return;
    const both = !sizes.includes(null);
    this.linked.setModel(both ? data.homography : null);
    this.farFootprint = both && data.homography ? footprint(data.homography, sizes[1]) : null;
    this.candidates = both ? (data.candidates ?? []).map((each) => footprint(each, sizes[1])) : [];
    this.setMode(this.farFootprint ? this.mode : "side");
    if (both) this.element.dataset.ready = "true";
  }

  get shortcuts() {
    return [
      { key: "1", label: "1", what: "side by side", act: () => this.setMode("side") },
      { key: "2", label: "2", what: "blend", act: () => this.setMode("blend") },
      { key: "3", label: "3", what: "swipe", act: () => this.setMode("swipe") },
      { key: "f", label: "f", what: "show whole images", act: () => this.fit() },
      { key: "z", label: "z", what: "zoom to the outline", act: () => this.zoomToOutline() },
      { key: "o", label: "o", what: "outline on or off", act: () => this.#toggle("outline") },
      { key: "m", label: "m", what: "matches that agree", act: () => this.#toggle("agrees") },
      { key: "d", label: "d", what: "matches that do not agree", act: () => this.#toggle("differs") },
      { key: "c", label: "c", what: "connecting lines", act: () => this.#toggle("lines") },
      { key: "k", label: "k", what: "landmarks", act: () => this.#toggle("landmarks") },
      { key: "l", label: "l", what: "link zoom and pan", act: () => this.#toggleLinked() },
      { key: "[", label: "[ ]", what: "less or more of the near image", act: () => this.#mix(-10) },
      { key: "]", label: "]", what: "", act: () => this.#mix(10) },
    ];
  }

  setMode(mode) {
    if (mode !== "side" && !this.farFootprint) return;
    this.mode = mode;
    this.stage.dataset.mode = mode;
    this.nearPane.hidden = mode !== "side";
    this.divider.element.hidden = mode !== "swipe";
    this.#buildToolbar();
    if (mode !== "side") {
      this.#loadOverlay();
      if (this.far.fitted) requestAnimationFrame(() => this.zoomToOutline());
    }
    this.#redraw();
  }

  fit() {
    this.far.fit();
    this.near.fit();
  }

  zoomToOutline() {
    if (!this.farFootprint) return;
    this.far.lookAtBox(bounds(this.farFootprint));
    this.near.fit();
  }

  /** Show a place that nothing confirms. */
  zoomToCandidate(index) {
    const points = this.candidates[index];
    if (!points) return;
    this.chosenCandidate = index;
    this.setMode("side");
    this.far.lookAtBox(bounds(points));
    this.#redraw();
  }

  /** The size of an image that is shown; null where it cannot be, or another pair is shown meanwhile. */
  async #load(view, ref, name) {
    const { data } = this;
    if (!ref) {
      view.say("This image is not in a folder that nearfar app was started with.");
      return null;
    }
    try {
      return await showImage(view, ref, (info) => {
        if (this.data !== data) return false;
        name.textContent = `${info.name} · ${info.width} × ${info.height}`;
        name.title = name.textContent;
        view.canvas.setAttribute("aria-label", `${view === this.far ? "Far" : "Near"} image ${info.name}`);
        return true;
      });
    } catch (error) {
      if (this.data === data) view.say(error.message);
      return null;
    }
  }

  async #loadOverlay() {
    const { data } = this;
    if (this.overlay || this.loadingOverlayOf === data) return;
    this.loadingOverlayOf = data;
    this.far.message.textContent = "Laying the near image over the far one…";
    let overlay = null, problem = "The outline does not meet the far image.";
    try {
      overlay = await warpedOverlay(data.near, data.homography, this.farFootprint, this.far.size);
    } catch (error) {
      problem = error.message;
    }
    if (this.data !== data) return;
    this.loadingOverlayOf = null;
    this.overlay = overlay;
    this.far.message.textContent = overlay ? "" : problem;
    this.element.dataset.overlay = this.overlay ? "ready" : "none";
    this.#redraw();
  }

  #buildToolbar() {
    const canOverlay = Boolean(this.farFootprint), { data } = this;
    const modes = h("div", { class: "segmented", role: "radiogroup", "aria-label": "View", onkeydown: (event) => this.#turn(event) },
      MODES.map(([mode, text]) => h("button", {
        type: "button", role: "radio", "aria-checked": String(this.mode === mode), dataset: { mode }, tabindex: this.mode === mode ? "0" : "-1",
        disabled: mode !== "side" && !canOverlay, onclick: () => this.setMode(mode),
        title: mode !== "side" && !canOverlay ? "Needs an outline of the near image in the far one" : "",
      }, text)));
    const mixing = this.mode === "blend" && h("label", { class: "mix" }, "Far",
      h("input", { type: "range", min: "0", max: "100", value: String(this.opacity), "aria-label": "Share of the near image",
        oninput: (event) => { this.opacity = Number(event.target.value); this.#redraw(); } }), "Near");
    const check = (name, text, colour) => h("label", { class: "check" },
      h("input", { type: "checkbox", checked: this.state[name], dataset: { layer: name },
        onchange: (event) => { this.state[name] = event.target.checked; this.#redraw(); } }),
      colour && h("i", { class: `swatch ${name}` }), text);
    const chosen = this.#chosen(), agreeing = chosen ? chosen.agreeing ?? chosen.inliers.filter(Boolean).length : 0;
    const total = chosen ? chosen.matches ?? chosen.inliers.length : 0;
    const steps = data.steps.length > 1 && h("label", { class: "select" }, "Step",
      h("select", { onchange: (event) => { this.step = event.target.value; this.#buildToolbar(); this.#redraw(); } },
        data.steps.map((each) => h("option", { value: each.name, selected: each.name === this.step },
          stepName(each.name) + (each.answer ? (data.homography ? " (answer)" : " (best)") : "")))));
    refill(this.toolbar, modes, mixing,
      h("div", { class: "checks" },
        canOverlay && check("outline", "Outline", true),
        data.fundamental && check("epipolar", "Epipolar lines"),
        this.mode === "side" && chosen && check("agrees", `Agree (${agreeing})`, true),
        this.mode === "side" && chosen && check("differs", `Differ (${total - agreeing})`, true),
        this.mode === "side" && chosen && check("lines", "Lines"),
        data.landmarks.length > 0 && check("landmarks", `Landmarks (${data.landmarks.length})`, true),
        this.mode === "side" && steps),
      h("div", { class: "tools" },
        this.mode === "side" && this.data.homography && iconButton("link", "Link zoom and pan (l)", () => this.#toggleLinked(), { "aria-pressed": String(this.linked.on) }),
        canOverlay && iconButton("target", "Zoom to the outline (z)", () => this.zoomToOutline()),
        iconButton("fit", "Show whole images (f)", () => this.fit()),
        iconButton("minus", "Zoom out", () => this.far.zoomBy(1 / 1.5)),
        iconButton("plus", "Zoom in", () => this.far.zoomBy(1.5))));
  }

  /** Arrow keys choose among the views, as in any group of radio buttons. */
  #turn(event) {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step || !this.farFootprint) return;
    event.preventDefault();
    const names = MODES.map(([mode]) => mode);
    this.setMode(names[(names.indexOf(this.mode) + step + names.length) % names.length]);
    this.toolbar.querySelector(`[data-mode=${this.mode}]`).focus();
  }

  #toggle(name) {
    this.state[name] = !this.state[name];
    this.#buildToolbar();
    this.#redraw();
  }

  #toggleLinked() {
    this.linked.on = !this.linked.on;
    this.#buildToolbar();
  }

  #mix(change) {
    if (this.mode === "swipe") this.divider.set(this.divider.share - change / 200);
    this.opacity = Math.min(100, Math.max(0, this.opacity + change));
    this.#buildToolbar();
    this.#redraw();
  }

  #redraw() {
    this.far.redraw();
    this.near.redraw();
  }

  #chosen() { return this.data.steps.find((each) => each.name === this.step); }

  #drawFar(context, view) {
    if (this.mode === "side") {
      const chosen = this.#chosen();
      if (chosen) this.#drawMatches(context, view, chosen.far, chosen.inliers);
    } else if (this.overlay) {
      this.#drawOverlay(context, view);
    }
    if (this.mode === "side") areas(context, view, this.data.masks?.far ?? []);
    unverified(context, view, this.candidates, this.chosenCandidate);
    this.#drawEpipolar(context, view, "far");
    if (this.state.outline && this.farFootprint) {
      polygon(context, view, this.farFootprint);
      topEdge(context, view, this.farFootprint);
    }
    if (this.state.landmarks) this.#drawLandmarks(context, view, "far");
    this.#drawHover(context, view, "far");
  }

  #drawNear(context, view) {
    const chosen = this.#chosen();
    areas(context, view, this.data.masks?.near ?? []);
    this.#drawEpipolar(context, view, "near");
    if (chosen) this.#drawMatches(context, view, chosen.near, chosen.inliers);
    if (this.state.landmarks) this.#drawLandmarks(context, view, "near");
    this.#drawHover(context, view, "near");
  }

  #drawEpipolar(context, view, role) {
    const { fundamental } = this.data, { match, under } = this.highlight ?? {};
    if (!fundamental || !this.state.epipolar || this.mode !== "side") return;
    const other = role === "far" ? "near" : "far";
    const pointer = match?.[other] ?? (under && under.view !== view ? under.point : null);
    drawEpipolarLines(context, view, fundamental, role, this.#chosen(), pointer);
  }

  #drawOverlay(context, view) {
    context.save();
    context.globalAlpha = this.mode === "blend" ? this.opacity / 100 : 1;
    if (this.mode === "swipe") {
      context.beginPath();
      context.rect(this.divider.share * view.width, 0, view.width, view.height);
      context.clip();
    }
    view.place(context, this.overlay.picture, this.overlay.box);
    context.restore();
  }

  #drawMatches(context, view, points, inliers) {
    const groups = [["differs", points.filter((_, i) => !inliers[i])], ["agrees", points.filter((_, i) => inliers[i])]];
    for (const [name, group] of groups) {
      if (this.state[name] && group.length) dots(context, view, group, COLOURS[name], dotRadius(view, group));
    }
  }

  #drawLandmarks(context, view, role) {
    this.data.landmarks.forEach((each, i) => {
      const lit = this.highlight?.landmark === i;
      context.globalAlpha = lit ? 1 : 0.8;
      box(context, view, each[role], COLOURS.landmark, lit ? 3 : 1.2);
    });
  }

  #drawHover(context, view, role) {
    const lit = this.highlight;
    if (!lit) return;
    if (lit.match) ring(context, view, lit.match[role], lit.match.agrees ? COLOURS.agrees : COLOURS.differs);
    else if (lit.ghost && lit.ghost.view === view) cross(context, view, lit.ghost.point, "#fff");
  }

  #hover(view, point) {
    this.highlight = point && this.data ? this.#under(view, point) : null;
    this.card.show(this.highlight?.match ?? null, this.far, this.near, this.data?.scaleChange);
    this.#redraw();
  }

  #under(view, point) {
    const role = view === this.far ? "far" : "near", reach = NEAREST / view.scale;
    const under = { view, point }, ghostPoint = this.linked.other(view, point);
    const ghost = ghostPoint && { view: view === this.far ? this.near : this.far, point: ghostPoint };
    const found = { ghost, under, match: this.mode === "side" ? this.#nearestMatch(role, point, reach) : null };
    if (this.state.landmarks) {
      const areas = this.data.landmarks.map((each, i) => [each[role], i]).filter(([[x, y, w, h]]) =>
        point[0] >= x && point[1] >= y && point[0] <= x + w && point[1] <= y + h);
      if (areas.length) found.landmark = areas.sort((a, b) => a[0][2] * a[0][3] - b[0][2] * b[0][3])[0][1];
    }
    return found;
  }

  #nearestMatch(role, point, reach) {
    const chosen = this.#chosen();
    if (!chosen) return null;
    let best = -1, least = reach;
    chosen[role].forEach((place, i) => {
      if (!(chosen.inliers[i] ? this.state.agrees : this.state.differs)) return;
      const apart = distance(place, point);
      if (apart < least) [best, least] = [i, apart];
    });
    if (best < 0) return null;
    const far = chosen.far[best], near = chosen.near[best], agrees = Boolean(chosen.inliers[best]);
    const { homography } = this.data;
    const { fundamental } = this.data;
    const error = homography ? distance(far, transform(homography, near)) : fundamental ? epipolarError(fundamental, far, near) : null;
    const off = error === null ? "" : `, ${error < 100 ? error.toFixed(1) : Math.round(error)} far pixels ${homography ? "off" : "from its line"}`;
    return { far, near, agrees, text: `${agrees ? "Agrees" : "Does not agree"}${off}` };
  }

  #drawLines() {
    const chosen = this.mode === "side" && this.data && this.#chosen();
    const { match } = this.highlight ?? {};
    const shown = !chosen || !this.state.lines ? []
      : chosen.far.map((_, i) => i).filter((i) => (chosen.inliers[i] ? this.state.agrees : this.state.differs));
    const thin = shown.map((i) => ({ far: chosen.far[i], near: chosen.near[i], agrees: Boolean(chosen.inliers[i]) }));
    drawMatchLines(this.lines, this.far, this.near, thin, chosen && match ? match : null);
  }
}
