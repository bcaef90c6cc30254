/** Where images and answers lie on the Earth: of a job, of a batch, or of a map. */

import { get } from "../api.js";
import { fill, h, icon } from "../dom.js";
import { notice } from "../job-view.js";
import { setShortcuts } from "../shortcuts.js";
import { WorldMap } from "../world-map.js";

const SOURCES = {
  job: [(id) => `/api/jobs/${id}/world`, (id) => `#/localize/${id}`],
  located: [(id) => `/api/jobs/${id}/world`, (id) => `#/map/${id}`],
  batch: [(id) => `/api/batches/${id}/world`, (id) => `#/batch/${id}`],
  map: [() => "/api/maps/world", () => "#/map"],
};
const NAMES = { answer: "Answer", image: "Image", position: "Camera" };

/** A link to the view of the world. */
export function worldLink(kind, id) {
  return h("a", { class: "button", href: `#/world/${kind}/${encodeURIComponent(id)}` }, icon("map"), "On the Earth");
}

export async function worldPage(main, [kind, id], signal) {
  const [path, back] = SOURCES[kind] ?? SOURCES.map;
  const heading = h("h1", {}, "On the Earth");
  const body = h("div", {}, h("p", { class: "quiet", role: "status" }, "Reading where the images lie…"));
  fill(main, h("div", { class: "page-head" }, h("a", { class: "back", href: back(id) }, "Back"), h("div", {}, heading)), body);
  try {
    const world = await get(path(id), kind === "map" ? { ref: id } : {});
    if (!signal.aborted) fill(body, world.features.length ? shown(world) : nowhere());
  } catch (error) {
    if (!signal.aborted) fill(body, notice("The places cannot be shown", error.message, null, "bad"));
  }
}

function shown(world) {
  const map = new WorldMap(world);
  setShortcuts("Map", map.shortcuts);
  const list = world.features.map((feature, i) => h("li", {}, h("button", { type: "button", class: "rank", onclick: () => map.zoomTo(i) },
    h("i", { class: `swatch world-${feature.kind}` }), h("span", { class: "rank-name", title: feature.name }, feature.name),
    h("span", { class: "quiet small" }, NAMES[feature.kind]))));
  return h("div", { class: "with-side" }, map.element,
    h("aside", { class: "side", "aria-label": "Places" }, h("h2", {}, `${world.features.length} ${world.features.length === 1 ? "place" : "places"}`), h("ul", { class: "ranks world-list" }, list)));
}

function nowhere() {
  return h("div", { class: "empty" }, icon("map"), h("h2", {}, "No place on the Earth is known"),
    h("p", { class: "quiet" }, "Images name one as a GeoTIFF, by a world file beside them, or by the GPS position of a photograph."));
}
