/** Making elements of the page. Text is always set as text, never parsed as HTML. */

/**
 * @param {string} tag
 * @param {Object<string, any>} [properties] attributes; `on…` are listeners, `class` and `dataset` too
 * @param {...(Node|string|number|null|undefined|false|Array)} children
 * @returns {HTMLElement}
 */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "dataset") Object.assign(element.dataset, value);
    else if (name in element && !name.startsWith("aria") && typeof value !== "string") element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  append(element, children);
  return element;
}

export function append(element, children) {
  for (const child of children.flat(Infinity)) {
    if (child === null || child === undefined || child === false) continue;
    element.append(child);
  }
  return element;
}

export function fill(element, ...children) {
  element.replaceChildren();
  return append(element, children);
}

const nameOf = (control) => control.getAttribute("aria-label") ?? (control.closest("label") ?? control).textContent;

/** Fill anew; the control that had the focus gives it to the one of the same name. */
export function refill(element, ...children) {
  const held = element.contains(document.activeElement) ? nameOf(document.activeElement) : null;
  fill(element, ...children);
  if (held !== null) [...element.querySelectorAll("button, input, select")].find((each) => nameOf(each) === held)?.focus();
}

const ICONS = {
  sun: "M12 4V2M12 22v-2M4 12H2M22 12h-2M6.3 6.3 4.9 4.9M19.1 19.1l-1.4-1.4M6.3 17.7l-1.4 1.4M19.1 4.9l-1.4 1.4M12 8a4 4 0 1 0 0 8 4 4 0 0 0 0-8",
  moon: "M20 14.5A8.5 8.5 0 0 1 9.5 4a8.5 8.5 0 1 0 10.5 10.5z",
  system: "M4 5h16v11H4zM9 20h6M12 16v4",
  help: "M9.2 9a2.9 2.9 0 0 1 5.7.8c0 2-2.9 2.6-2.9 4.2M12 17.5v.1M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18",
  image: "M4 5h16v14H4zM4 16l5-5 4 4 3-3 4 4M15.5 9v.1",
  folder: "M3 6h6l2 2h10v11H3z",
  map: "M9 4 3 6.5V20l6-2.5 6 2.5 6-2.5V4l-6 2.5zM9 4v13.5M15 6.5V20",
  table: "M4 5h16v14H4zM4 10h16M4 14.5h16M10 10v9",
  swap: "M7 4 3 8l4 4M3 8h14M17 12l4 4-4 4M21 16H7",
  close: "M6 6l12 12M18 6 6 18",
  plus: "M12 5v14M5 12h14",
  minus: "M5 12h14",
  fit: "M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5",
  target: "M12 5a7 7 0 1 0 0 14 7 7 0 0 0 0-14M12 2v6M12 16v6M2 12h6M16 12h6",
  link: "M10 14a4 4 0 0 0 6 0l3-3a4 4 0 0 0-6-6l-1 1M14 10a4 4 0 0 0-6 0l-3 3a4 4 0 0 0 6 6l1-1",
  undo: "M4 9h10a5 5 0 0 1 0 10h-4M4 9l4-4M4 9l4 4",
  redo: "M20 9H10a5 5 0 0 0 0 10h4M20 9l-4-4M20 9l-4 4",
  trash: "M5 7h14M9 7V4h6v3M7 7l1 13h8l1-13",
  download: "M12 4v11M7 11l5 5 5-5M5 20h14",
  again: "M5 12a7 7 0 1 0 2-5M7 3v4h4",
  check: "M5 13l4 4L19 7",
  alert: "M12 4 2.5 20h19zM12 10v4M12 17v.1",
  play: "M8 5v14l11-7z",
  pause: "M9 5v14M15 5v14",
  before: "M15 5l-8 7 8 7",
  after: "M9 5l8 7-8 7",
  route: "M6 20a2 2 0 1 0 0-4 2 2 0 0 0 0 4M18 8a2 2 0 1 0 0-4 2 2 0 0 0 0 4M8 18h7a3 3 0 0 0 0-6H9a3 3 0 0 1 0-6h7",
  pencil: "M4 20l1-4L16 5l3 3L8 19z",
};

/** A line icon that screen readers skip. */
export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

export function iconButton(name, label, onclick, properties = {}) {
  return h("button", { type: "button", class: "icon-button", "aria-label": label, title: label, onclick, ...properties }, icon(name));
}

/** Say something for a few seconds; errors stay longer. */
export function toast(text, kind = "info") {
  const note = h("div", { class: `toast ${kind}` }, text);
  document.getElementById("toasts").append(note);
  setTimeout(() => note.remove(), kind === "error" ? 9000 : 3500);
}

/** A modal dialog; resolves with the value it was closed with. */
export function dialog(title, build, className = "") {
  return new Promise((resolve) => {
    const close = (value) => { element.close(); element.remove(); resolve(value); };
    const heading = h("h2", { id: "dialog-title" }, title);
    const element = h("dialog", { class: className, "aria-labelledby": "dialog-title" },
      h("div", { class: "dialog-head" }, heading, iconButton("close", "Close", () => close(null))));
    element.addEventListener("cancel", (event) => { event.preventDefault(); close(null); });
    element.addEventListener("click", (event) => { if (event.target === element) close(null); });
    append(element, [build(close)]);
    document.body.append(element);
    element.showModal();
  });
}

export function confirmed(title, text, action) {
  return dialog(title, (close) => h("div", { class: "dialog-body" },
    h("p", {}, text),
    h("footer", {},
      h("button", { type: "button", onclick: () => close(false) }, "Cancel"),
      h("button", { type: "button", class: "primary", autofocus: true, onclick: () => close(true) }, action))), "small");
}

export function formatSeconds(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  return seconds < 10 ? `${seconds.toFixed(1)} s` : `${Math.round(seconds)} s`;
}

export function formatNumber(value, digits = 2) {
  return value === null || value === undefined ? "–" : value.toFixed(digits);
}

export function formatTime(seconds) {
  const date = new Date(seconds * 1000), today = new Date().toDateString() === date.toDateString();
  const options = today ? { hour: "2-digit", minute: "2-digit" } : { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit" };
  return date.toLocaleString(undefined, options);
}
