/** Which page is shown, by the fragment of the address: #/page/part/… */

import { fill, h, icon } from "./dom.js";
import { annotatePage } from "./pages/annotate.js";
import { batchPage } from "./pages/batch.js";
import { keptPage } from "./pages/kept.js";
import { localizePage } from "./pages/localize.js";
import { mapPage } from "./pages/map.js";
import { resultsPage } from "./pages/results.js";
import { trackPage } from "./pages/track.js";
import { worldPage } from "./pages/world.js";
import { listenForShortcuts, setGlobalShortcuts, setShortcuts, showHelp } from "./shortcuts.js";
import { setUpTheme } from "./theme.js";

const PAGES = {
  localize: ["Localize", localizePage],
  batch: ["Batch", batchPage],
  map: ["Map", mapPage],
  track: ["Track", trackPage],
  results: ["Results", resultsPage],
  annotate: ["Annotate", annotatePage],
  kept: ["Kept images", keptPage],
  world: ["World", worldPage],
};

const main = document.getElementById("main");
let leaving = new AbortController();

/** A part of the address; one that is not encoded well stays as it is. */
function decoded(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

/** Pages get the element to fill, the parts of the address, and a signal that they are left. */
function show() {
  const [name, ...parts] = location.hash.replace(/^#\/?/, "").split("/").map(decoded);
  const page = Object.hasOwn(PAGES, name) ? name : "localize";
  leaving.abort();
  leaving = new AbortController();
  setShortcuts("", []);
  fill(main);
  main.className = `page-${page}`;
  const [title, build] = PAGES[page];
  document.title = `${title} · nearfar`;
  for (const link of document.querySelectorAll("nav [data-page]")) {
    if (link.dataset.page === page) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  Promise.resolve(build(main, parts.filter(Boolean), leaving.signal)).catch((error) => {
    fill(main, h("div", { class: "notice bad", role: "alert" }, h("div", {}, h("h2", {}, "This page cannot be shown"), h("p", {}, error.message))));
  });
}

const help = document.getElementById("help-button");
fill(help, icon("help"));
help.addEventListener("click", showHelp);
const changeTheme = setUpTheme(document.getElementById("theme-button"));
const go = (page) => () => { location.hash = `#/${page}`; };
setGlobalShortcuts([
  { key: "?", label: "?", what: "this overview", act: showHelp },
  { key: "t", label: "t", what: "light, dark or as the system", act: changeTheme },
  { key: "L", label: "Shift L", what: "Localize", act: go("localize") },
  { key: "B", label: "Shift B", what: "Batch", act: go("batch") },
  { key: "M", label: "Shift M", what: "Map", act: go("map") },
  { key: "T", label: "Shift T", what: "Track", act: go("track") },
  { key: "R", label: "Shift R", what: "Results", act: go("results") },
  { key: "A", label: "Shift A", what: "Annotate", act: go("annotate") },
]);
listenForShortcuts();
// The fragment of the address names the page, so it must not change.
document.querySelector(".skip").addEventListener("click", (event) => { event.preventDefault(); main.focus(); });
// A file that misses its place must not replace the page.
for (const type of ["dragover", "drop"]) document.addEventListener(type, (event) => event.preventDefault());
window.addEventListener("hashchange", () => { show(); main.focus({ preventScroll: true }); window.scrollTo(0, 0); });
show();
