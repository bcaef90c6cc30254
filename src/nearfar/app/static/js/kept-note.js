/** Where the images go, said wherever one can be dropped. */

import { h } from "./dom.js";

/** @param {{local: boolean}} about what the server says of itself */
export function keptNote({ local }) {
  return h("p", { class: "small quiet more-options" },
    local ? "Nothing leaves this machine." : "What you drop here goes to the machine that runs nearfar app, and no further.",
    " ", h("a", { href: "#/kept" }, "Images kept by this app"));
}
