/** Light, dark, or as the system is set. The choice is kept in this browser. */

import { fill, icon } from "./dom.js";

const KEY = "nearfar-theme";
const NEXT = { system: "light", light: "dark", dark: "system" };
const ICON = { system: "system", light: "sun", dark: "moon" };

export function setUpTheme(button) {
  const show = (choice) => {
    if (choice === "system") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = choice;
    fill(button, icon(ICON[choice]));
    button.setAttribute("aria-label", `Colours: ${choice}. Change to ${NEXT[choice]}`);
    button.title = `Colours: ${choice} (t)`;
  };
  let choice = localStorage.getItem(KEY);
  if (!(choice in NEXT)) choice = "system";
  show(choice);
  const change = () => {
    choice = NEXT[choice];
    localStorage.setItem(KEY, choice);
    show(choice);
  };
  button.addEventListener("click", change);
  return change;
}
