/** The handle of the swipe view, moved by pointer and by arrow keys. */

import { h } from "./dom.js";

const STEPS = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 };

export class Divider {
  /** @param {HTMLElement} frame that it lies in @param {() => void} onMove */
  constructor(frame, onMove) {
    this.frame = frame;
    this.onMove = onMove;
    this.element = h("div", {
      class: "divider", role: "slider", tabindex: "0", hidden: true, "aria-label": "Swipe position",
      "aria-valuemin": "0", "aria-valuemax": "100", "aria-orientation": "horizontal",
    });
    frame.append(this.element);
    this.#listen();
    this.set(0.5);
  }

  /** @param {number} share of the frame to the left of it */
  set(share) {
    this.share = Math.min(1, Math.max(0, share));
    this.element.style.left = `${this.share * 100}%`;
    this.element.setAttribute("aria-valuenow", Math.round(this.share * 100));
    this.onMove();
  }

  #listen() {
    const { element } = this;
    element.addEventListener("pointerdown", (event) => element.setPointerCapture(event.pointerId));
    element.addEventListener("pointermove", (event) => {
      if (!element.hasPointerCapture(event.pointerId)) return;
      const frame = this.frame.getBoundingClientRect();
      this.set((event.clientX - frame.left) / frame.width);
    });
    element.addEventListener("keydown", (event) => {
      const step = STEPS[event.key];
      if (!step) return;
      this.set(this.share + step);
      event.preventDefault();
    });
  }
}
