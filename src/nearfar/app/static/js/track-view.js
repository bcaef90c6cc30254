/** A camera that was followed: its path on the far image, a timeline, and the chosen frame. */

import { pictureAddress } from "./api.js";
import { CanvasView } from "./canvas-view.js";
import { fill, formatNumber, h, icon, iconButton, refill } from "./dom.js";
import { bounds, distance } from "./geometry.js";
import { confidenceMeter, confidenceText, facts } from "./job-view.js";
import { polygon, topEdge } from "./marks.js";
import { planOf } from "./plan.js";
import { showImage } from "./show-image.js";
import { Timeline } from "./timeline.js";
import { chosenMark, markElement, trackLine, trackMarks } from "./track-marks.js";

const NEAREST = 18, PLAYED_EVERY = 120, PICTURE_AFTER = 160, MOST_LISTED = 100;
export const STATES = { tracked: "Tracked", relocalized: "Found in the whole map", predicted: "Predicted", lost: "Lost" };
const STEPS = { prediction: "matches at the predicted place", neighbourhood: "matches around it", odometry: "the motion between frames", map: "a search of the whole map", motion: "constant velocity" };

const known = (frame) => frame.status === "tracked" || frame.status === "relocalized";

/** Where the picture of a frame is; null where it is not served. */
export function frameAddress(track, frame, thumbnail = false) {
  const source = track.sources[frame.source];
  if (!source) return null;
  if (source.kind === "video") {
    const query = new URLSearchParams({ ref: source.ref, seconds: Number(frame.name.split("#t=")[1]) || frame.time });
    if (thumbnail) query.set("thumbnail", "true");
    return `/api/tracks/frame?${query}`;
  }
  return pictureAddress(source.kind === "folder" ? `${source.ref}/${frame.name}` : source.ref, thumbnail);
}

export class TrackView {
  /** @param {() => (Node|null)[]} actions builds what is offered below the facts */
  constructor(actions) {
    this.actions = actions;
    this.canvas = new CanvasView("Path on the far image");
    this.canvas.layers.push((context, view) => this.#draw(context, view));
    this.canvas.addEventListener("press", (event) => this.#press(event.detail));
    this.timeline = new Timeline();
    this.timeline.addEventListener("choose", (event) => this.choose(event.detail));
    this.state = { path: true, footprint: true, outlines: false };
    this.toolbar = h("div", { class: "toolbar", role: "toolbar", "aria-label": "How the track is shown" });
    this.legend = h("ul", { class: "track-legend", "aria-label": "Marks" });
    this.detail = h("div", { class: "track-detail" });
    this.missing = h("div", {});
    this.more = h("div", {});
    this.name = h("span", {});
    this.element = h("div", { class: "with-side" },
      h("section", { class: "viewer track-viewer", "aria-label": "Track" }, this.toolbar,
        h("figure", { class: "pane track-pane" }, h("figcaption", {}, h("b", {}, "Far"), this.name), this.canvas.element),
        this.timeline.element, this.legend),
      h("aside", { class: "side", "aria-label": "Frame" }, this.detail, this.missing, this.more));
    this.track = null;
    this.frames = [];
    this.chosen = 0;
    this.shown = null;
    this.playing = 0;
  }

  /** @param {object} track whose frames are added to those that are shown where it starts after them */
  show(track) {
    const first = !this.frames.length;
    this.frames = track.start ? [...this.frames.slice(0, track.start), ...track.frames] : track.frames;
    this.track = track;
    this.plan = null;
    if (track.plan) this.#layPlan();
    this.timeline.show(this.frames);
    this.#buildToolbar();
    this.#buildLegend();
    this.#listMissing();
    if (this.frames.length) this.choose(first ? Math.max(0, this.frames.findIndex(known)) : this.chosen);
    this.element.dataset.frames = String(this.frames.length);
  }

  get shortcuts() {
    return [
      { key: "j", label: "j", what: "next frame", act: () => this.choose(this.chosen + 1) },
      { key: "b", label: "b", what: "frame before", act: () => this.choose(this.chosen - 1) },
      { key: "n", label: "n", what: "next frame that was not found", act: () => this.#nextMissing() },
      { key: "p", label: "p", what: "play or pause", act: () => this.#play() },
      { key: "f", label: "f", what: "show the whole image", act: () => this.canvas.fit() },
      { key: "z", label: "z", what: "zoom to the path", act: () => this.zoomToPath() },
    ];
  }

  choose(index) {
    if (!this.frames.length) return;
    this.chosen = Math.min(Math.max(0, index), this.frames.length - 1);
    const frame = this.frames[this.chosen];
    const text = `Frame ${this.chosen + 1} of ${this.frames.length}: ${STATES[frame.status]}` + (known(frame) ? `, confidence ${confidenceText(frame.confidence)}` : "");
    this.timeline.choose(this.chosen, text);
    this.#showImage(frame.image);
    this.#showDetail(frame, text);
    this.canvas.redraw();
  }

  zoomToPath() {
    const places = this.#visible().flatMap((each) => each.outline ?? (each.place ? [each.place] : []));
    if (places.length > 1) this.canvas.lookAtBox(bounds(places), 0.86);
  }

  stop() {
    clearInterval(this.playing);
    this.playing = 0;
  }

  /** The frames that lie in the image that is shown, with their places in it. */
  #visible() {
    if (this.plan) return this.frames.map((each) => ({ ...each, place: each.place && this.plan.at(each.place) }));
    return this.frames.filter((each) => each.image === this.shown && each.image !== null);
  }

  #layPlan() {
    const places = this.frames.filter((each) => each.place).map((each) => each.place);
    if (!places.length) return;
    const before = this.planned;
    this.plan = planOf(places, this.track.plan);
    this.planned = places.length;
    this.name.textContent = `as seen from above, ${this.track.plan.join(" and ")} in units of the map`;
    this.canvas.canvas.setAttribute("aria-label", "Path as seen from above");
    if (before !== places.length) this.canvas.show(this.plan.picture, this.plan.size);
  }

  /** Load the map image of a frame, unless it is shown. */
  async #showImage(number) {
    if (this.plan || number === null || number === this.shown) {
      if (!this.plan && number === null && this.shown === null) this.canvas.say("This frame has no place in a map image.");
      return;
    }
    this.shown = number;
    const { name, ref } = this.track.images[number];
    this.name.textContent = name.split("/").at(-1);
    this.name.title = name;
    if (!ref) {
      this.canvas.say("The map image is not in a folder that nearfar app was started with.");
      return;
    }
    this.canvas.say("Loading…");
    try {
      const size = await showImage(this.canvas, ref, (info) => {
        if (this.shown !== number) return false;
        this.name.textContent = `${info.name} · ${info.width} × ${info.height}`;
        this.canvas.canvas.setAttribute("aria-label", `Path on ${info.name}`);
        return true;
      });
      if (!size) return;
      this.element.dataset.ready = "true";
    } catch (error) {
      if (this.shown === number) this.canvas.say(error.message);
    }
  }

  #buildToolbar() {
    const check = (name, text) => h("label", { class: "check" }, h("input", { type: "checkbox", checked: this.state[name], dataset: { layer: name },
      onchange: (event) => { this.state[name] = event.target.checked; this.canvas.redraw(); } }), text);
    const missing = this.frames.filter((each) => !known(each)).length;
    refill(this.toolbar,
      h("div", { class: "segmented" },
        iconButton("before", "Frame before (b)", () => this.choose(this.chosen - 1)),
        this.play = iconButton(this.playing ? "pause" : "play", this.playing ? "Pause (p)" : "Play (p)", () => this.#play()),
        iconButton("after", "Next frame (j)", () => this.choose(this.chosen + 1))),
      h("div", { class: "checks" }, check("path", "Path"), !this.track.plan && check("footprint", "Footprint"), !this.track.plan && check("outlines", "All outlines")),
      h("div", { class: "tools" },
        missing > 0 && h("button", { type: "button", class: "link", onclick: () => this.#nextMissing() }, "Next not found"),
        iconButton("target", "Zoom to the path (z)", () => this.zoomToPath()),
        iconButton("fit", "Show the whole image (f)", () => this.canvas.fit()),
        iconButton("minus", "Zoom out", () => this.canvas.zoomBy(1 / 1.5)),
        iconButton("plus", "Zoom in", () => this.canvas.zoomBy(1.5))));
  }

  #buildLegend() {
    fill(this.legend, Object.entries(STATES).map(([status, text]) => [this.frames.filter((each) => each.status === status).length, status, text])
      .filter(([count]) => count).map(([count, status, text]) => h("li", {}, markElement(status), `${text} (${count})`)));
  }

  #play() {
    if (this.playing) this.stop();
    else {
      if (this.chosen === this.frames.length - 1) this.choose(0);
      this.playing = setInterval(() => {
        if (!this.element.isConnected || this.chosen >= this.frames.length - 1) { this.stop(); this.#buildToolbar(); return; }
        this.choose(this.chosen + 1);
      }, PLAYED_EVERY);
    }
    this.#buildToolbar();
  }

  #nextMissing() {
    const order = [...this.frames.keys()].map((i) => (this.chosen + 1 + i) % this.frames.length);
    const next = order.find((i) => !known(this.frames[i]));
    if (next !== undefined) this.choose(next);
  }

  #press(point) {
    let best = null, least = NEAREST / this.canvas.scale;
    for (const frame of this.#visible()) {
      const apart = frame.place ? distance(frame.place, point) : Infinity;
      if (apart < least) [best, least] = [frame, apart];
    }
    if (best) this.choose(this.frames.findIndex((each) => each.index === best.index));
  }

  #draw(context, view) {
    if (!this.track) return;
    if (this.plan) this.plan.drawGrid(context, view);
    const frames = this.#visible(), chosen = this.frames[this.chosen];
    const frame = chosen && frames.find((each) => each.index === chosen.index);
    if (this.state.outlines) for (const each of frames) if (each.outline) polygon(context, view, each.outline, "rgba(255, 255, 255, 0.55)", 1);
    if (this.state.path) { trackLine(context, view, frames); trackMarks(context, view, frames); }
    if (!frame) return;
    if (this.state.footprint && frame.outline) { polygon(context, view, frame.outline); topEdge(context, view, frame.outline); }
    if (frame.looks && frame.place) this.#drawLook(context, view, frame);
    chosenMark(context, view, frame);
  }

  /** A stroke to where a camera looks, as seen from above. */
  #drawLook(context, view, { place, looks: [right, up] }) {
    const [x, y] = view.toScreen(place);
    context.strokeStyle = "#ff7a1a";
    context.lineWidth = 3;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x + 34 * right, y - 34 * up);
    context.stroke();
  }

  #showDetail(frame, text) {
    const address = frameAddress(this.track, frame), number = (value, unit, digits = 1) => (value === null ? null : `${formatNumber(value, digits)}${unit}`);
    const rows = [
      ["Time", `${formatNumber(frame.time, 2)} s`],
      ["Confidence", known(frame) ? confidenceText(frame.confidence) : "–", known(frame) && confidenceMeter(frame.confidence)],
      frame.error !== null && ["Expected error", number(frame.error, " px")],
      known(frame) && ["Matches that agree", String(frame.inliers)],
      frame.step && ["Placed by", STEPS[frame.step] ?? frame.step],
      frame.degrees && ["Longitude, latitude", frame.degrees.map((value) => value.toFixed(6)).join(", ")],
      frame.heading !== null && ["Heading", number(frame.heading, "°", 0)],
      frame.height !== null && ["Height over the ground", number(frame.height, " m")],
      frame.centre && ["Position", frame.centre.map((value) => value.toFixed(2)).join(", ")],
    ];
    if (!this.pictured) {
      this.picture = h("img", { alt: "", hidden: true });
      this.link = h("a", { class: "frame-link", target: "_blank", rel: "noopener" }, this.picture, h("span", {}, icon("image"), "Open the frame's picture"));
      this.heading = h("h2", { class: "track-state" });
      this.rows = h("div", {});
      this.said = h("p", { class: "quiet small" });
      this.pictured = true;
      fill(this.detail, this.heading, this.link, this.said, this.rows);
      fill(this.more, h("div", { class: "side-actions" }, this.actions()));
    }
    fill(this.heading, markElement(frame.status), text.split(": ")[0], h("span", { class: "quiet" }, STATES[frame.status]));
    this.said.textContent = frame.reason ? `${frame.name}: ${frame.reason}` : frame.name;
    fill(this.rows, facts(rows));
    this.missing.querySelectorAll("button").forEach((each) => each.setAttribute("aria-pressed", String(Number(each.dataset.frame) === this.chosen)));
    this.link.hidden = !address;
    if (address) this.#loadPicture(address, frameAddress(this.track, frame, true), frame.name);
  }

  /** The thumbnail is asked for when a frame stays chosen for a moment. */
  #loadPicture(address, thumbnail, name) {
    this.link.href = address;
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => {
      this.picture.onload = () => { this.picture.hidden = false; };
      this.picture.onerror = () => { this.picture.hidden = true; };
      this.picture.alt = `Frame ${name}`;
      this.picture.src = thumbnail;
    }, PICTURE_AFTER);
  }

  /** List the frames that were not found, as buttons. */
  #listMissing() {
    const frames = [...this.frames.entries()].filter(([, each]) => !known(each));
    const { open } = this.missing.querySelector("details") ?? {};
    fill(this.missing, frames.length > 0 && h("details", { open }, h("summary", {}, `Not found (${frames.length})`), h("div", { class: "ranks" },
      frames.slice(0, MOST_LISTED).map(([i, each]) => h("button", { type: "button", class: "rank", dataset: { frame: String(i) }, "aria-pressed": String(i === this.chosen), onclick: () => this.choose(i) },
        markElement(each.status), h("span", { class: "rank-name" }, each.name), h("span", { class: "quiet" }, STATES[each.status])))),
    frames.length > MOST_LISTED && h("p", { class: "quiet small" }, "Only the first ones are listed; the timeline has all.")));
  }
}
