/** Keyboard shortcuts of the page that is shown, and the overlay that lists them. */

import { dialog, h } from "./dom.js";

/** @typedef {{key: string, label: string, what: string, act: () => void}} Shortcut */

const GLOBAL = [];
let local = [];
let localTitle = "";

/** @param {Shortcut[]} shortcuts that hold on every page */
export function setGlobalShortcuts(shortcuts) {
  GLOBAL.push(...shortcuts);
}

/** @param {string} title of the page @param {Shortcut[]} shortcuts that hold until the next call */
export function setShortcuts(title, shortcuts) {
  local = shortcuts;
  localTitle = title;
}

export function listenForShortcuts() {
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.altKey || document.querySelector("dialog[open]")) return;
    const typing = event.target.matches("input:not([type=range]):not([type=checkbox]):not([type=radio]), textarea, select");
    if (typing) return;
    const name = (event.ctrlKey || event.metaKey ? "Ctrl+" : "") + event.key;
    if (name === "Enter" && event.target.matches("button, a, summary")) return;
    const found = [...local, ...GLOBAL].find((each) => each.key === name);
    if (!found) return;
    event.preventDefault();
    found.act();
  });
}

export function showHelp() {
  if (document.querySelector("dialog[open]")) return;
  const table = (title, shortcuts) => shortcuts.length > 0 && h("section", {},
    h("h3", {}, title),
    h("dl", { class: "keys" }, shortcuts.map(({ label, what }) => [
      h("dt", {}, label.split(" ").map((key) => h("kbd", {}, key))), h("dd", {}, what)])));
  dialog("Keyboard shortcuts", () => h("div", { class: "dialog-body", tabindex: "0", role: "region", "aria-label": "List of shortcuts" },
    table(localTitle, local.filter((each) => each.what)),
    table("An image that has the focus", IMAGE_KEYS),
    table("Everywhere", GLOBAL)), "help");
}

const IMAGE_KEYS = [
  { label: "← → ↑ ↓", what: "move" },
  { label: "+ −", what: "zoom" },
];
