/** A card that shows one match: both places magnified, and how well they agree. */

import { h } from "./dom.js";
import { patch } from "./marks.js";

const SCALE = 2.5;

export class MatchCard {
  constructor() {
    this.far = h("canvas", { class: "patch" });
    this.near = h("canvas", { class: "patch" });
    this.text = h("p", {});
    this.element = h("div", { class: "match-card", hidden: true },
      h("div", { class: "patches" },
        h("figure", {}, this.far, h("figcaption", {}, "Far")),
        h("figure", {}, this.near, h("figcaption", {}, "Near"))),
      this.text);
  }

  /** @param {{far: number[], near: number[], text: string}|null} match */
  show(match, farView, nearView, scaleChange) {
    this.element.hidden = match === null;
    if (!match) return;
    const change = Math.min(12, Math.max(1 / 12, scaleChange || 1));
    patch(this.far, farView, match.far, SCALE * Math.sqrt(change));
    patch(this.near, nearView, match.near, SCALE / Math.sqrt(change));
    this.text.textContent = match.text;
  }
}
