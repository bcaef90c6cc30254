/** A timeline of frames: a slider with a lane for each state, and the confidence above. */

import { h } from "./dom.js";

const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 100, CONFIDENCE = 46;
/** Lanes by their top edges: what is known of a frame is told by its lane, not by colour alone. */
export const LANES = [
  { name: "found", text: "Found", top: 54, states: ["tracked", "relocalized"] },
  { name: "predicted", text: "Predicted", top: 71, states: ["predicted"] },
  { name: "lost", text: "Lost", top: 88, states: ["lost"] },
];
const LANE = 10, GAP = 0.08, FAR = 10;

function draw(tag, attributes) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

const bars = (indices, top, height) => indices.map((i) => `M${i + GAP} ${top}h${1 - 2 * GAP}v${height}h${2 * GAP - 1}z`).join("");

/** Events: "choose" (detail: index of a frame). */
export class Timeline extends EventTarget {
  constructor() {
    super();
    this.paths = Object.fromEntries(["confidence", ...LANES.map((each) => each.name), "relocalized"].map((name) => [name, draw("path", { class: `lane-${name}`, "vector-effect": "non-scaling-stroke" })]));
    this.cursor = draw("line", { y1: 0, y2: HEIGHT, class: "cursor", "vector-effect": "non-scaling-stroke" });
    this.svg = draw("svg", { preserveAspectRatio: "none", "aria-hidden": "true" });
    this.svg.append(...Object.values(this.paths), this.cursor);
    this.slider = h("div", { class: "timeline-slider", role: "slider", tabindex: "0", "aria-label": "Frame", onkeydown: (event) => this.#key(event) }, this.svg);
    const label = (text, top) => { const span = h("span", {}, text); span.style.top = `${top}%`; return span; };
    this.element = h("div", { class: "timeline" },
      h("div", { class: "timeline-labels", "aria-hidden": "true" }, label("Confidence", 16), LANES.map((each) => label(each.text, each.top + LANE / 2))), this.slider);
    this.frames = [];
    this.chosen = 0;
    const point = (event) => {
      const box = this.slider.getBoundingClientRect();
      this.#choose(Math.floor(((event.clientX - box.left) / box.width) * this.frames.length));
    };
    this.slider.addEventListener("pointerdown", (event) => { this.slider.setPointerCapture(event.pointerId); point(event); });
    this.slider.addEventListener("pointermove", (event) => { if (this.slider.hasPointerCapture(event.pointerId)) point(event); });
  }

  /** @param {{status: string, confidence: number, name: string}[]} frames */
  show(frames) {
    this.frames = frames;
    const numbers = frames.map((_, i) => i), of = (states) => numbers.filter((i) => states.includes(frames[i].status));
    this.svg.setAttribute("viewBox", `0 0 ${Math.max(1, frames.length)} ${HEIGHT}`);
    for (const { name, top, states } of LANES) this.paths[name].setAttribute("d", bars(of(states), top, LANE));
    const steps = frames.map(({ confidence }, i) => `L${i} ${CONFIDENCE * (1 - confidence)}h1`).join("");
    this.paths.confidence.setAttribute("d", `M0 ${CONFIDENCE}${steps}V${CONFIDENCE}z`);
    this.paths.relocalized.setAttribute("d", of(["relocalized"]).map((i) => `M${i + 0.5} 0V${LANES[0].top + LANE}`).join(""));
    this.choose(this.chosen, "");
  }

  /** Show which frame is chosen; the text is read by screen readers. */
  choose(index, text) {
    this.chosen = Math.min(Math.max(0, index), Math.max(0, this.frames.length - 1));
    for (const end of ["x1", "x2"]) this.cursor.setAttribute(end, this.chosen + 0.5);
    const { slider } = this, values = { min: 1, max: Math.max(1, this.frames.length), now: this.chosen + 1 };
    for (const [name, value] of Object.entries(values)) slider.setAttribute(`aria-value${name}`, String(value));
    if (text) slider.setAttribute("aria-valuetext", text);
  }

  #choose(index) {
    if (!this.frames.length) return;
    const held = Math.min(Math.max(0, index), this.frames.length - 1);
    if (held !== this.chosen) this.dispatchEvent(new CustomEvent("choose", { detail: held }));
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const to = { ArrowLeft: this.chosen - 1, ArrowDown: this.chosen - 1, ArrowRight: this.chosen + 1, ArrowUp: this.chosen + 1,
      PageDown: this.chosen - FAR, PageUp: this.chosen + FAR, Home: 0, End: this.frames.length - 1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    this.#choose(to);
  }
}
