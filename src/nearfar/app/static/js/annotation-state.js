/** The points of an annotation with undo, and their way to the server. */

import { put } from "./api.js";

const DELAY = 250;
const MOST_UNDO = 200;

/** Events: "change" (points), "judged" (the server has said what they say), "saving", "saved", "lost". */
export class AnnotationState extends EventTarget {
  constructor(opened) {
    super();
    this.annotation = opened.annotation;
    this.agreement = opened.agreement;
    this.points = opened.annotation.points.map((pair) => ({ ...pair }));
    this.before = [];
    this.after = [];
    this.timer = null;
    this.sending = null;
    this.dirty = false;
  }

  /** Whether all that was changed has reached the server. */
  get kept() { return !this.dirty && !this.sending; }
  get marked() { return this.points.filter((pair) => pair.far && pair.near).length; }

  /** Change the points; one step of undo. */
  edit(change) {
    this.begin();
    change(this.points);
    this.changed();
  }

  /** Remember the points as they are, before something is dragged. */
  begin() {
    this.before.push(this.#copy());
    if (this.before.length > MOST_UNDO) this.before.shift();
    this.after = [];
  }

  undo() { this.#step(this.before, this.after); }
  redo() { this.#step(this.after, this.before); }

  rename(name, model) {
    this.annotation = { ...this.annotation, name, model };
    this.changed();
  }

  changed() {
    this.dirty = true;
    this.dispatchEvent(new Event("change"));
    this.dispatchEvent(new Event("saving"));
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.save(), DELAY);
  }

  /** Send what has changed; one request at a time, so that versions follow each other. */
  async save() {
    clearTimeout(this.timer);
    while (this.sending) await this.sending;
    if (!this.dirty) return;
    this.dirty = false;
    this.sending = this.#send().finally(() => { this.sending = null; });
    await this.sending;
  }

  async #send() {
    const { id, version, name, model } = this.annotation;
    try {
      const opened = await put(`/api/annotations/${id}`, { version, name, model, points: this.points });
      this.annotation = { ...opened.annotation, name: this.dirty ? this.annotation.name : opened.annotation.name, model: this.annotation.model };
      this.agreement = opened.agreement;
      this.dispatchEvent(new Event("judged"));
      if (!this.dirty) this.dispatchEvent(new Event("saved"));
    } catch (error) {
      this.dirty = true;
      this.dispatchEvent(new CustomEvent("lost", { detail: error }));
      // A conflict needs a decision; anything else may pass.
      if (error.status !== 409) this.timer = setTimeout(() => this.save(), 3000);
    }
  }

  #step(from, to) {
    if (!from.length) return;
    to.push(this.#copy());
    this.points = from.pop();
    this.changed();
  }

  #copy() { return this.points.map((pair) => ({ far: pair.far, near: pair.near })); }
}
