/** Marking corresponding points in two images. */

import { exportPanel } from "./annotation-export.js";
import { AnnotationState } from "./annotation-state.js";
import { CanvasView } from "./canvas-view.js";
import { fill, formatNumber, h, iconButton, toast } from "./dom.js";
import { distance, inside, inverse, transform } from "./geometry.js";
import { facts } from "./job-view.js";
import { Linked } from "./linked.js";
import { COLOURS, cross, label, patch, ring, wanted } from "./marks.js";
import { showImage } from "./show-image.js";

const GRAB = 12;
const COVERED = 0.13;
const CLOSE_ENOUGH = 4;
const LOUPE = 6;
const FINE = 0.1;
const COARSE = 1;
const WELL_BELOW = 2;
const ENLARGED = 3;

export class AnnotationEditor {
  constructor(opened) {
    this.state = new AnnotationState(opened);
    this.targets = opened.targets;
    this.selected = null;
    this.views = { far: new CanvasView("Far image: click to mark a point"), near: new CanvasView("Near image: click to mark a point") };
    this.linked = new Linked(this.views.far, this.views.near);
    this.linked.on = false;
    this.loupes = { far: h("canvas", { class: "loupe", "aria-hidden": "true" }), near: h("canvas", { class: "loupe", "aria-hidden": "true" }) };
    this.saved = h("span", { class: "saved", role: "status" }, "Saved");
    this.hint = h("p", { class: "hint", role: "status", "aria-live": "polite" });
    this.list = h("div", { class: "points" });
    this.summary = h("div", {});
    this.undo = iconButton("undo", "Undo (Ctrl+Z)", () => this.state.undo());
    this.redo = iconButton("redo", "Redo (Ctrl+Y)", () => this.state.redo());
    this.element = this.#build();
    for (const role of ["far", "near"]) this.#setUp(role);
    this.state.addEventListener("change", () => this.#refresh());
    this.state.addEventListener("judged", () => this.#refresh());
    this.state.addEventListener("saving", () => this.#say("Saving…", ""));
    this.state.addEventListener("saved", () => this.#say("Saved", "good"));
    this.state.addEventListener("lost", (event) => { this.#say("Not saved", "bad"); toast(event.detail.message, "error"); });
    this.#refresh();
  }

  get shortcuts() {
    return [
      { key: "Enter", label: "Enter", what: "accept the suggested place", act: () => this.#accept() },
      { key: "n", label: "n", what: "go to the next place to mark", act: () => this.#nextTarget() },
      { key: "Ctrl+z", label: "Ctrl Z", what: "undo", act: () => this.state.undo() },
      { key: "Ctrl+y", label: "Ctrl Y", what: "redo", act: () => this.state.redo() },
      { key: "Delete", label: "Del", what: "delete the chosen point", act: () => this.#delete() },
      { key: "Escape", label: "Esc", what: "choose nothing", act: () => this.#select(null) },
      { key: "f", label: "f", what: "show whole images", act: () => { this.views.far.fit(); this.views.near.fit(); } },
      { key: "l", label: "l", what: "link zoom and pan", act: () => this.#toggleLinked() },
      { key: "set", label: "Space", what: "mark the point under the cross of the image that has the focus", act: () => {} },
      { key: "nudge", label: "← → ↑ ↓", what: "move the chosen point by 0.1 pixels, with Shift by 1; without one, the image", act: () => {} },
    ];
  }

  async load() {
    const { annotation } = this.state;
    await Promise.all(["far", "near"].map(async (role) => {
      this.views[role].say("Loading…");
      try {
        await showImage(this.views[role], annotation[role]);
      } catch {
        this.views[role].say("This image is not there any more. The points are kept.");
      }
    }));
    this.element.dataset.ready = "true";
    this.#refresh();
  }

  leave() {
    if (this.state.dirty) this.state.save();
  }

  #build() {
    const { annotation } = this.state;
    const name = h("input", { type: "text", value: annotation.name, maxlength: "80", "aria-label": "Name of the pair", class: "title-input",
      onchange: () => this.state.rename(name.value.trim() || "pair", this.state.annotation.model) });
    const model = h("select", { "aria-label": "What relates the images", onchange: () => this.state.rename(this.state.annotation.name, model.value) },
      [["homography", "Flat scene"], ["fundamental", "Scene with depth"]].map(([value, text]) => h("option", { value, selected: value === annotation.model }, text)));
    const pane = (role, title) => h("figure", { class: "pane" },
      h("figcaption", {}, h("b", {}, title), h("span", { title: annotation[`${role}_name`] }, annotation[`${role}_name`])), this.views[role].element);
    for (const role of ["far", "near"]) this.views[role].element.append(this.loupes[role]);
    this.linkButton = iconButton("link", "Link zoom and pan (l)", () => this.#toggleLinked(), { "aria-pressed": "false" });
    return h("div", { class: "editor" },
      h("div", { class: "page-head" }, h("a", { class: "back", href: "#/annotate" }, "Annotations"),
        h("h1", { class: "visually-hidden" }, "Mark points in both images"), h("div", {}, name, this.saved)),
      h("div", { class: "with-side" },
        h("section", { class: "viewer", "aria-label": "Images" },
          h("div", { class: "toolbar", role: "toolbar", "aria-label": "Annotation" }, this.hint,
            h("div", { class: "tools" }, this.undo, this.redo, this.linkButton,
              iconButton("target", "Next place to mark (n)", () => this.#nextTarget()),
              iconButton("fit", "Show whole images (f)", () => { this.views.far.fit(); this.views.near.fit(); }))),
          h("div", { class: "stage" }, pane("far", "Far"), pane("near", "Near"))),
        h("aside", { class: "side", "aria-label": "Points" }, this.summary,
          h("label", { class: "field" }, "What the images show", model), this.list,
          exportPanel(this.state))));
  }

  #setUp(role) {
    const view = this.views[role];
    view.layers.push((context) => this.#draw(context, role));
    view.addEventListener("press", (event) => this.#press(role, event.detail));
    view.addEventListener("hover", (event) => this.#loupe(role, event.detail));
    view.grab = (at) => this.#grab(role, at);
    view.useKey = (event) => this.#set(role, event) || this.#nudge(role, event);
    for (const type of ["focus", "blur"]) view.canvas.addEventListener(type, () => this.#redraw());
  }

  /** Take hold of a point under the pointer; null where there is none. */
  #grab(role, at) {
    const view = this.views[role];
    const index = this.state.points.findIndex((pair) => pair[role] && distance(view.toScreen(pair[role]), at) < GRAB);
    if (index < 0) return null;
    this.#select(index);
    const held = view.toImage(at), from = this.state.points[index][role];
    let moved = false;
    return {
      move: (point, travelled) => {
        if (travelled <= CLOSE_ENOUGH) return;
        if (!moved) this.state.begin();
        moved = true;
        this.state.points[index][role] = this.#clamped(role, [from[0] + point[0] - held[0], from[1] + point[1] - held[1]]);
        this.#loupe(role, this.state.points[index][role]);
        this.#redraw();
      },
      drop: () => { if (moved) this.state.changed(); },
    };
  }

  #press(role, point) {
    if (!inside(point, this.views[role].size)) return;
    const other = role === "far" ? "near" : "far";
    const open = this.state.points.findIndex((pair) => !pair[role] && pair[other]);
    const place = this.#clamped(role, point);
    let index = open;
    this.state.edit((points) => {
      if (open >= 0) points[open][role] = place;
      else index = points.push({ far: null, near: null, [role]: place }) - 1;
    });
    this.#select(index);
    if (open < 0) this.#lookAtSuggestion(index, other);
  }

  /** Where the other image should show a point, by the points marked so far; null if not known. */
  #suggestion(index) {
    const pair = this.state.points[index], { homography } = this.state.agreement;
    if (!pair || !homography || this.state.annotation.model !== "homography" || (pair.far && pair.near)) return null;
    const role = pair.far ? "near" : "far";
    const point = transform(role === "far" ? homography : inverse(homography), pair.far ?? pair.near);
    return point.every(Number.isFinite) && inside(point, this.views[role].size) ? { role, point } : null;
  }

  #lookAtSuggestion(index, role) {
    const suggestion = this.#suggestion(index), view = this.views[role];
    if (suggestion) view.lookAt(suggestion.point, Math.max(view.scale, ENLARGED));
  }

  #accept() {
    const index = this.selected ?? this.state.points.findIndex((pair) => !pair.far || !pair.near);
    const suggestion = this.#suggestion(index);
    if (!suggestion) return;
    this.state.edit((points) => { points[index][suggestion.role] = this.#clamped(suggestion.role, suggestion.point); });
    this.#select(index);
    this.views[suggestion.role].canvas.focus();
  }

  /** Mark the point under the cross in the middle, by keyboard; the other image is next. */
  #set(role, event) {
    if (event.key !== " " || !this.views[role].picture) return false;
    this.#press(role, this.views[role].centre);
    const pair = this.state.points[this.selected], other = role === "far" ? "near" : "far";
    if (pair && !pair[other]) this.views[other].canvas.focus();
    return true;
  }

  #nudge(role, event) {
    const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] ?? [];
    const pair = this.state.points[this.selected];
    if (dx === undefined || !pair?.[role]) return false;
    const step = event.shiftKey ? COARSE : FINE, [x, y] = pair[role];
    this.state.edit((points) => { points[this.selected][role] = this.#clamped(role, [x + dx * step, y + dy * step]); });
    this.#loupe(role, this.state.points[this.selected][role]);
    return true;
  }

  #delete() {
    if (this.selected === null) return;
    const index = this.selected;
    this.selected = null;
    this.state.edit((points) => points.splice(index, 1));
  }

  #select(index) {
    this.selected = index;
    this.#refresh();
  }

  #toggleLinked() {
    this.linked.on = !this.linked.on;
    this.linkButton.setAttribute("aria-pressed", String(this.linked.on));
  }

  #nextTarget() {
    const left = this.#openTargets()[0];
    if (!left) return;
    this.#select(null);
    const { near, far } = this.views, { homography } = this.state.agreement;
    near.lookAt(left.point, Math.max(near.fitScale * 2.5, near.scale));
    if (homography) far.lookAt(transform(homography, left.point), Math.max(far.scale, ENLARGED));
    near.canvas.focus();
  }

  /** Target places without a marked point nearby; each marked point serves the one it is nearest to. */
  #openTargets() {
    const [width, height] = this.state.annotation.near_size, reach = COVERED * Math.hypot(width, height);
    const open = this.targets.map((point, i) => ({ point, number: i + 1 }));
    for (const { near } of this.state.points) {
      if (!near) continue;
      const nearest = open.map((target) => distance(target.point, near)).reduce((best, d, i, all) => (d < (all[best] ?? Infinity) ? i : best), 0);
      if (open.length && distance(open[nearest].point, near) < reach) open.splice(nearest, 1);
    }
    return this.state.points.length >= this.targets.length && this.state.marked >= this.targets.length ? [] : open;
  }

  #clamped(role, point) {
    return point.map((value, i) => Math.round(Math.min(this.views[role].size[i] - 0.5, Math.max(-0.5, value)) * 100) / 100);
  }

  #loupe(role, point) {
    const canvas = this.loupes[role], view = this.views[role];
    const shown = point && inside(point, view.size) ? point : this.state.points[this.selected]?.[role];
    canvas.classList.toggle("shown", Boolean(shown && view.picture));
    const corner = shown && view.toScreen(shown);
    canvas.classList.toggle("left", Boolean(corner && corner[0] > view.width - 190 && corner[1] < 190));
    if (shown) patch(canvas, view, shown, Math.max(LOUPE, view.scale * WELL_BELOW));
  }

  #draw(context, role) {
    const view = this.views[role], { agreement, points } = this.state;
    if (role === "near") {
      this.#openTargets().forEach(({ point, number }, i) => wanted(context, view, point, String(number), i === 0));
    }
    points.forEach((pair, i) => {
      if (!pair[role]) return;
      const colour = pair.far && pair.near ? this.#colour(i) : COLOURS.suggestion;
      const options = i === this.selected ? { arm: 15, width: 2.4 } : {};
      cross(context, view, pair[role], colour, options);
      if (i === this.selected) ring(context, view, pair[role], colour, 19, 1.5);
      label(context, view, pair[role], String(i + 1), colour);
    });
    points.forEach((_, i) => {
      const suggestion = this.#suggestion(i);
      if (suggestion?.role !== role) return;
      ring(context, view, suggestion.point, COLOURS.suggestion, 14, 1.5);
      cross(context, view, suggestion.point, COLOURS.suggestion, { dash: [3, 3] });
    });
    if (agreement.homography && role === "far") this.#drawResiduals(context, view);
    if (view.canvas.matches(":focus-visible")) cross(context, view, view.centre, COLOURS.target, { arm: 22 });
  }

  /** Where the fit puts each near point in the far image. */
  #drawResiduals(context, view) {
    context.strokeStyle = COLOURS.differs;
    context.lineWidth = 2;
    for (const pair of this.state.points) {
      if (!pair.far || !pair.near) continue;
      context.beginPath();
      context.moveTo(...view.toScreen(pair.far));
      context.lineTo(...view.toScreen(transform(this.state.agreement.homography, pair.near)));
      context.stroke();
    }
  }

  #colour(index) {
    const error = this.state.agreement.far_errors[index];
    if (this.state.annotation.model !== "homography" || error === null || error === undefined || this.state.marked < 5) return COLOURS.agrees;
    return error < 2 ? COLOURS.agrees : error < 5 ? COLOURS.landmark : COLOURS.differs;
  }

  #say(text, kind) {
    this.saved.textContent = text;
    this.saved.className = `saved ${kind}`;
  }

  #redraw() {
    this.views.far.redraw();
    this.views.near.redraw();
  }

  #refresh() {
    const { state } = this, { agreement } = state, flat = state.annotation.model === "homography";
    if (this.selected !== null && this.selected >= state.points.length) this.selected = null;
    this.linked.setModel(flat ? agreement.homography : null);
    this.undo.disabled = !state.before.length;
    this.redo.disabled = !state.after.length;
    this.hint.textContent = this.#hintText();
    fill(this.summary, facts([
      ["Points", `${state.marked} of 10`],
      ["Scale change", agreement.scale_change ? `${formatNumber(agreement.scale_change)}×` : "–"],
      flat && ["Transfer error (STE)", agreement.ste === null ? "–" : `${formatNumber(agreement.ste)} px`],
      flat && agreement.ste !== null && state.marked !== 10 && ["STE for ten points", `${formatNumber(agreement.ste_of_ten)} px`],
    ]), flat && agreement.reason && state.marked > 0 && h("p", { class: "quiet small" }, `No estimate yet: ${agreement.reason}.`),
    flat && state.marked === 4 && h("p", { class: "quiet small" }, "Four points always fit. From the fifth on the errors mean something."));
    fill(this.list, state.points.length > 0 && h("table", { class: "plain points-table" },
      h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Point"), h("th", { scope: "col", class: "number" }, "Error far"), h("th", { scope: "col", class: "number" }, "Error near"), h("th", {}, h("span", { class: "visually-hidden" }, "Delete")))),
      h("tbody", {}, state.points.map((pair, i) => this.#pointRow(pair, i, flat)))));
    this.#redraw();
  }

  #pointRow(pair, i, flat) {
    const value = (error, role) => (!pair[role] ? "missing" : flat && error !== null && error !== undefined ? error.toFixed(2) : "·");
    return h("tr", { class: i === this.selected ? "chosen" : "" },
      h("th", { scope: "row" }, h("button", { type: "button", class: "link", "aria-pressed": String(i === this.selected), onclick: () => this.#goTo(i) }, `${i + 1}`)),
      h("td", { class: "number" }, value(this.state.agreement.far_errors[i], "far")),
      h("td", { class: "number" }, value(this.state.agreement.near_errors[i], "near")),
      h("td", { class: "number" }, iconButton("trash", `Delete point ${i + 1}`, () => { this.selected = i; this.#delete(); })));
  }

  #goTo(index) {
    for (const role of ["far", "near"]) {
      const point = this.state.points[index][role], view = this.views[role];
      if (point) view.lookAt(point, Math.max(view.scale, ENLARGED));
    }
    this.#select(index);
    for (const role of ["far", "near"]) this.#loupe(role, null);
  }

  #hintText() {
    const open = this.state.points.findIndex((pair) => !pair.far || !pair.near);
    if (open >= 0) {
      const missing = this.state.points[open].far ? "near" : "far";
      const suggested = this.#suggestion(open) ? " Enter accepts the suggestion." : "";
      return `Point ${open + 1}: now click the same place in the ${missing} image, or move it under the cross by arrow keys and press Space.${suggested}`;
    }
    const left = this.#openTargets();
    if (!left.length) return "Ten places are marked. Look at the errors, then export.";
    return `Click a place that you can recognize near circle ${left[0].number} in the near image.`;
  }
}
