/** Locate a photograph in a map of many images. */

import { get, post, remove } from "../api.js";
import { cameraChoice } from "../camera-choice.js";
import { confirmed, fill, formatNumber, formatSeconds, formatTime, h, icon, iconButton, toast } from "../dom.js";
import { ImageSlot } from "../image-slot.js";
import { showJob } from "../job-page.js";
import { badge, confidenceText, facts, notice } from "../job-view.js";
import { keptNote } from "../kept-note.js";
import { PairViewer } from "../pair-viewer.js";
import { worldPose } from "../pose-words.js";
import { setShortcuts } from "../shortcuts.js";
import { expectedError } from "../wording.js";
import { worldLink } from "./world.js";

export async function mapPage(main, [id], signal) {
  if (!id) await start(main);
  else await showJob(main, id, signal, { href: "#/map", text: "New photograph" }, (job) => answers(job, signal));
}

async function start(main) {
  const [about, maps] = await Promise.all([get("/api/about"), get("/api/find", { kind: "map" })]);
  const intro = h("div", { class: "intro" }, h("h1", {}, "Which picture shows this place?"),
    h("p", { class: "lead" }, "Give a photograph. nearfar looks for it in a map of many images."));
  if (about.maps || !maps.length) {
    fill(main, intro, noMaps(about.maps));
    return;
  }
  const slot = new ImageSlot("Photograph", "It is looked for in all images of the map.");
  const choice = h("div", { class: "choices", role: "radiogroup", "aria-label": "Map" }, maps.map((each, i) =>
    h("label", { class: "choice" }, h("input", { type: "radio", name: "map", value: each.ref, checked: i === 0 }), icon("map"), h("span", {}, each.name))));
  const camera = cameraChoice("map-camera", "Camera of the photograph", ["none", "given"], () => ready());
  const go = h("button", { type: "button", class: "primary large", disabled: true, id: "locate", onclick: () => submit() }, "Locate");
  const submit = async () => {
    if (go.disabled) return;
    go.disabled = true;
    try {
      const folder = choice.querySelector("input:checked").value;
      const job = await post("/api/jobs", { kind: "locate", folder, query: slot.image.ref, camera: camera.value });
      location.hash = `#/map/${job.id}`;
    } catch (error) {
      toast(error.message, "error");
      go.disabled = false;
    }
  };
  const ready = () => { go.disabled = !slot.image || !camera.complete; };
  slot.addEventListener("change", ready);
  const look = () => { location.hash = `#/world/map/${encodeURIComponent(choice.querySelector("input:checked").value)}`; };
  setShortcuts("Map", [{ key: "Enter", label: "Enter", what: "locate", act: submit }]);
  const recent = h("section", { class: "recent" });
  fill(main, intro, h("div", { class: "slots two" }, h("section", { class: "panel" }, h("h2", {}, "Map"), choice,
    h("div", {}, h("button", { type: "button", id: "map-world", onclick: look }, icon("map"), "Its images on the Earth"))), slot.element),
    h("div", { class: "form-row" }, camera.element, go), keptNote(about), recent);
  showRecent(recent);
}

function noMaps(missing) {
  return h("div", { class: "empty" }, icon("map"),
    h("h2", {}, missing ? "Maps need a further package" : "There is no map yet"),
    h("p", { class: "quiet" }, missing ?? "Make one, and start the app with the folder that holds the map and its photographs:"),
    !missing && h("pre", {}, "nearfar map build photos/ --out town\nnearfar app ."));
}

async function showRecent(element) {
  const jobs = (await get("/api/jobs")).filter((job) => job.request.kind === "locate").slice(0, 12);
  if (!jobs.length) return;
  fill(element, h("h2", {}, "Recent"), h("ul", { class: "rows" }, jobs.map((job) => h("li", {},
    h("a", { href: `#/map/${job.id}` },
      h("span", { class: "pair-name" }, job.names[1], h("span", { class: "quiet" }, " in "), job.names[0]),
      h("span", { class: "quiet" }, job.summary), badge(job), h("time", { class: "quiet" }, formatTime(job.created))),
    iconButton("trash", `Delete ${job.names[1]}`, async () => {
      if (await confirmed("Delete this job?", "Its answer is deleted with it. The images stay.", "Delete")) {
        await remove(`/api/jobs/${job.id}`);
        showRecent(fill(element));
      }
    })))));
}

function answers(job, signal) {
  const element = h("div", {}, h("p", { class: "quiet" }, "Loading…"));
  get(`/api/jobs/${job.id}/result`).then((result) => {
    if (signal.aborted) return;
    if (!result.answers.length) fill(element, notFound(job, result));
    else fill(element, ranked(job, result));
  }).catch((error) => fill(element, notice("The answer cannot be read", error.message, null, "bad")));
  return element;
}

function notFound(job, result) {
  return h("div", {}, unverifiedPlaces(job, result), notice("Not found",
    result.candidates.length
      ? "Some images of the map looked promising, but in none of them the photograph could be placed with confidence."
      : "Nothing in the photograph looks like anything in the map.", null, "warn"),
    candidates(result), h("details", {}, h("summary", {}, "In the method's words"), h("p", { class: "quiet small" }, result.reason)));
}

/** The places in refused images that look most like the photograph: listed, and the chosen one drawn dashed. */
function unverifiedPlaces(job, result) {
  const places = result.candidates.filter((each) => each.place && each.far).sort((a, b) => (b.place.score ?? 0) - (a.place.score ?? 0));
  if (!places.length) return null;
  const viewer = new PairViewer();
  setShortcuts("Viewer", viewer.shortcuts);
  const buttons = places.map((each, i) => h("button", { type: "button", class: "rank", "aria-pressed": "false", onclick: () => choose(i) },
    h("b", {}, String(i + 1)), h("span", { class: "rank-name", title: each.image }, each.image.split("/").at(-1)),
    h("span", { class: "quiet" }, each.place.score === null ? "not compared" : `${Math.round(100 * each.place.score)}% looks alike`)));
  const choose = (i) => {
    buttons.forEach((button, k) => button.setAttribute("aria-pressed", String(k === i)));
    viewer.show({ far: places[i].far, near: job.request.query, homography: null, steps: [], landmarks: [], scaleChange: null,
      candidates: [places[i].place.homography] });
  };
  choose(0);
  return h("div", { class: "with-side" }, viewer.element, h("aside", { class: "side unverified", "aria-label": "Unverified places" },
    h("h2", {}, "Unverified places"), h("p", { class: "quiet small" }, "Nothing confirms them: look whether one is right."), h("div", { class: "ranks" }, buttons)));
}

function ranked(job, result) {
  const viewer = new PairViewer(), detail = h("div", {});
  setShortcuts("Viewer", viewer.shortcuts);
  const buttons = result.answers.map((answer, i) => h("button", { type: "button", class: "rank", "aria-pressed": "false", onclick: () => choose(i) },
    h("b", {}, String(i + 1)), h("span", { class: "rank-name", title: answer.image }, answer.image.split("/").at(-1)), h("span", { class: "quiet" }, confidenceText(answer.confidence))));
  const choose = (i) => {
    const answer = result.answers[i];
    buttons.forEach((button, k) => button.setAttribute("aria-pressed", String(k === i)));
    fill(detail, facts([
      ["Scale change", `${formatNumber(answer.scale_change)}×`],
      answer.expected_error != null && ["Expected error", expectedError({ mean: answer.expected_error })],
      ["Votes", formatNumber(answer.votes, 1)],
      ["Matches that agree", `${answer.steps[0].agreeing} of ${answer.steps[0].matches}`],
    ]), place(answer.world));
    viewer.show({ far: answer.far, near: job.request.query, homography: answer.far_from_near.homography ?? null,
      steps: answer.steps, landmarks: [], scaleChange: answer.scale_change });
  };
  const total = Object.values(result.seconds).reduce((a, b) => a + b, 0);
  const side = h("aside", { class: "side", "aria-label": "Answers" },
    h("p", { class: "verdict good" }, icon("check"), result.answers.length === 1 ? "Found in one image" : `Found in ${result.answers.length} images`),
    h("div", { class: "ranks" }, buttons), result.world?.world_from_query && worldPose(result.world), detail, candidates(result),
    h("p", { class: "quiet small" }, formatSeconds(total)),
    h("div", { class: "side-actions" }, h("a", { class: "button", href: `/api/jobs/${job.id}/result`, download: "location.json" }, icon("download"), "JSON"), worldLink("located", job.id)));
  choose(0);
  return h("div", { class: "with-side" }, viewer.element, side);
}

/** Coordinates on the Earth, where the map image is georeferenced. */
function place(world) {
  if (!world?.centre) return null;
  const degrees = world.longitude_latitude?.centre;
  return h("section", { class: "numbers" }, h("h2", {}, "On the Earth"), facts([
    degrees && ["Longitude", degrees[0].toFixed(7)],
    degrees && ["Latitude", degrees[1].toFixed(7)],
    world.heading !== null && world.heading !== undefined && ["Heading", `${world.heading.toFixed(0)}°`],
    ["Centre", world.centre.map((value) => value.toFixed(2)).join(", ")],
    world.crs.length < 40 && ["System", world.crs],
  ]));
}

function candidates(result) {
  const refused = result.candidates.filter((each) => each.reason);
  if (!refused.length) return null;
  return h("details", {}, h("summary", {}, `Looked at and refused (${refused.length})`),
    h("ul", { class: "refused" }, refused.map((each) => h("li", {}, h("b", {}, each.image), h("span", { class: "quiet" }, `${formatNumber(each.votes, 1)} votes; ${each.reason}`)))));
}
