/** Localize a pair: choose two images, watch the progress, look at the answer. */

import { get, post, remove } from "../api.js";
import { pairOfCameras } from "../camera-choice.js";
import { confirmed, fill, formatNumber, formatSeconds, formatTime, h, icon, iconButton, toast } from "../dom.js";
import { exportButton } from "../export-menu.js";
import { ImageSlot } from "../image-slot.js";
import { showJob } from "../job-page.js";
import { keptNote } from "../kept-note.js";
import { badge, confidenceMeter, confidenceText, facts, notice } from "../job-view.js";
import { matcherChoice } from "../matcher-choice.js";
import { offers } from "../offers.js";
import { PairViewer } from "../pair-viewer.js";
import { relativePose } from "../pose-words.js";
import { setShortcuts } from "../shortcuts.js";
import { effortName, expectedError, stepName } from "../wording.js";
import { worldLink } from "./world.js";

export async function localizePage(main, [id], signal) {
  if (!id) await start(main);
  else await showJob(main, id, signal, { href: "#/localize", text: "New pair" }, (job, again) => answer(job, signal, again));
}

async function start(main) {
  const about = await get("/api/about"), { efforts, matchers, devices } = about;
  const slots = pairOfSlots(true);
  const model = h("select", { id: "model" },
    h("option", { value: "homography" }, "Flat scene, or camera that only turned"),
    h("option", { value: "fundamental" }, "Scene with depth"),
    h("option", { value: "pose", disabled: true }, "Scene with depth, and the pose (needs cameras)"));
  const effort = h("select", { id: "effort" }, efforts.reverse().map((value) => h("option", { value }, effortName(value))));
  const choice = matcherChoice(matchers, devices);
  const cameras = pairOfCameras(() => {
    const pose = model.querySelector("[value=pose]");
    pose.disabled = !cameras.both;
    if (pose.disabled && model.value === "pose") model.value = "fundamental";
  });
  const go = h("button", { type: "button", class: "primary large", disabled: true, id: "localize", onclick: () => submit() }, "Localize");
  const submit = async () => {
    if (go.disabled) return;
    go.disabled = true;
    try {
      const job = await post("/api/jobs", { kind: "localize", far: slots.far.image.ref, near: slots.near.image.ref, model: model.value, max_effort: effort.value, ...choice.chosen, ...cameras.chosen, far_mask: slots.far.areas, near_mask: slots.near.areas });
      location.hash = `#/localize/${job.id}`;
    } catch (error) {
      toast(error.message, "error");
      go.disabled = false;
    }
  };
  slots.onChange(() => { go.disabled = !slots.complete; });
  setShortcuts("Localize", [
    { key: "Enter", label: "Enter", what: "localize", act: submit },
    { key: "x", label: "x", what: "swap far and near", act: slots.swap },
  ]);
  const recent = h("section", { class: "recent" });
  fill(main,
    h("div", { class: "intro" }, h("h1", {}, "Where does the close-up lie?"),
      h("p", { class: "lead" }, "Give an overview and a close-up of the same place. nearfar finds the close-up in the overview, also where it is many times smaller there.")),
    slots.element,
    h("div", { class: "form-row" },
      h("label", { class: "field", for: "model" }, "What the images show", model),
      h("label", { class: "field", for: "effort" }, "How much to try", effort),
      go),
    cameras.element, choice.element,
    keptNote(about),
    recent);
  showRecent(recent);
}

/** Two slots with a button between them that swaps them; parts of the images can be left out where masks are used. */
export function pairOfSlots(masks = false) {
  const far = new ImageSlot("Far image", "The overview: it shows more of the scene, smaller.", masks);
  const near = new ImageSlot("Near image", "The close-up: it shows the scene larger.", masks);
  const swap = () => {
    const [a, b] = [[far.image, far.areas], [near.image, near.areas]];
    far.set(...b);
    near.set(...a);
  };
  const element = h("div", { class: "slots" }, far.element, iconButton("swap", "Swap far and near", swap, { class: "icon-button swap" }), near.element);
  return {
    far, near, swap, element,
    get complete() { return Boolean(far.image && near.image); },
    onChange(listener) { for (const slot of [far, near]) slot.addEventListener("change", listener); },
  };
}

async function showRecent(element) {
  const jobs = (await get("/api/jobs")).filter((job) => job.request.kind === "localize" && !job.batch).slice(0, 12);
  if (!jobs.length) return;
  fill(element, h("h2", {}, "Recent"), h("ul", { class: "rows" }, jobs.map((job) => h("li", {},
    h("a", { href: `#/localize/${job.id}` },
      h("span", { class: "pair-name" }, job.names[1], h("span", { class: "quiet" }, " in "), job.names[0]),
      h("span", { class: "quiet" }, job.summary), badge(job),
      h("time", { class: "quiet" }, formatTime(job.created))),
    iconButton("trash", `Delete ${job.names[1]} in ${job.names[0]}`, async () => {
      if (await confirmed("Delete this job?", "Its answer is deleted with it. The images stay.", "Delete")) {
        await remove(`/api/jobs/${job.id}`);
        showRecent(fill(element));
      }
    })))));
}

function answer(job, signal, again) {
  const viewer = new PairViewer(), side = h("aside", { class: "side", "aria-label": "Answer" }, h("p", { class: "quiet" }, "Loading…"));
  const element = h("div", { class: "with-side" }, viewer.element, side);
  setShortcuts("Viewer", viewer.shortcuts);
  get(`/api/jobs/${job.id}/result`).then((result) => {
    if (signal.aborted) return;
    const found = result.localization;
    fill(side, answerFacts(job, result, again, viewer));
    viewer.show({
      far: job.request.far, near: job.request.near, homography: found.far_from_near?.homography ?? null,
      steps: result.steps, landmarks: result.landmarks, scaleChange: found.scale_change,
      masks: { far: job.request.far_mask ?? [], near: job.request.near_mask ?? [] },
      candidates: otherPlaces(found).map((each) => each.homography),
      fundamental: result.epipolar ?? found.far_from_near?.fundamental ?? null,
    });
  }).catch((error) => fill(element, notice("The answer cannot be read", error.message, h("button", { type: "button", class: "primary", onclick: again }, "Start again"), "bad")));
  return element;
}

function answerFacts(job, result, again, viewer) {
  const found = result.localization, localized = found.status === "localized";
  const total = Object.values(found.seconds).reduce((a, b) => a + b, 0);
  return [
    localized ? h("p", { class: "verdict good" }, icon("check"), "Localized") : h("div", { class: "verdict-block" },
      h("p", { class: "verdict warn" }, icon("alert"), "Not found"), h("p", {}, result.explanation),
      h("details", {}, h("summary", {}, "In the method's words"), h("p", { class: "quiet small" }, found.reason)),
      unverifiedPlaces(found.candidates ?? [], viewer, (found.alternatives ?? []).length)),
    result.warning && h("p", { class: "caution" }, icon("alert"), result.warning),
    offers(job.request, found),
    alternatives(found.alternatives ?? [], viewer),
    facts([
      ["Scale change", found.scale_change && localized ? `${formatNumber(found.scale_change)}×` : "–"],
      ["Confidence", confidenceText(found.confidence), confidenceMeter(found.confidence)],
      found.expected_error && ["Expected error", expectedError(found.expected_error)],
      agreeing(result),
      masked(job.request) && ["Left out by masks", masked(job.request)],
      found.excluded && ["Left out as an overlay", `${found.excluded.matches} matches`],
      ...focalLengths(found.intrinsics),
      job.request.matcher && job.request.matcher !== "sift" && ["Matcher", job.request.matcher],
      localized && found.step && ["Found by", stepName(found.step)],
      ["Time", formatSeconds(total)],
    ]),
    found.far_from_near?.rotation && relativePose(found.far_from_near),
    found.model !== "homography" && localized && bent(found.intrinsics) && h("p", { class: "quiet small" }, "Epipolar lines are curved under the distortion of the lens, and are not drawn."),
    h("details", {}, h("summary", {}, "Numbers"), numbers(found)),
    h("div", { class: "side-actions" },
      h("a", { class: "button", href: `/api/jobs/${job.id}/result`, download: "localization.json" }, icon("download"), "JSON"),
      exportButton(`/api/jobs/${job.id}`),
      localized && found.model === "homography" && worldLink("job", job.id),
      h("button", { type: "button", onclick: again }, icon("again"), "Again"),
      h("button", { type: "button", onclick: () => annotate(job) }, icon("pencil"), "Annotate")),
  ];
}

/** Places beside the answer, in the order in which the viewer numbers them. */
const otherPlaces = (found) => [...(found.alternatives ?? []), ...(found.candidates ?? [])];

function placeButton(viewer, index, text) {
  return h("button", { type: "button", class: "rank", onclick: () => viewer.zoomToCandidate(index) },
    h("b", {}, String(index + 1)), h("span", { class: "rank-name" }, text));
}

/** Places that explain the near image nearly as well as the answer: listed, and drawn dashed. */
function alternatives(places, viewer) {
  if (!places.length) return null;
  return h("section", { class: "unverified" }, h("h2", {}, "Places that fit nearly as well"),
    h("p", { class: "quiet small" }, "The confidence is shared among them and the answer."),
    h("div", { class: "ranks" }, places.map((each, i) => placeButton(viewer, i, `${Math.round(100 * each.score)}% of the points of the answer`))));
}

/** Places that were tried and not accepted: listed, and drawn dashed. */
function unverifiedPlaces(candidates, viewer, before) {
  if (!candidates.length) return null;
  return h("section", { class: "unverified" }, h("h2", {}, "Unverified places"),
    h("p", { class: "quiet small" }, "Nothing confirms them: look whether one is right."),
    h("div", { class: "ranks" }, candidates.map((each, i) =>
      placeButton(viewer, before + i, each.score === null ? "not compared" : `${Math.round(100 * each.score)}% looks alike`))));
}

const bent = (cameras) => Boolean(cameras?.far?.distortion || cameras?.near?.distortion);

/** The focal lengths of the cameras, and where they are from. */
function focalLengths(cameras) {
  const from = { exif: "by EXIF", estimated: "estimated", given: "given" };
  return ["far", "near"].map((role) => cameras?.[role] && [`Focal length, ${role}`, `${cameras[role].fx.toFixed(0)} px, ${from[cameras[role].origin] ?? cameras[role].origin}`]);
}

function numbers(found) {
  const model = found.far_from_near, matrix = model?.homography ?? model?.fundamental ?? model?.rotation;
  const title = { homography: "Homography, near to far", fundamental: "Fundamental matrix", pose: "Rotation, near to far camera" }[found.model];
  return h("div", { class: "numbers" },
    matrix && [h("h2", {}, title),
      h("table", { class: "matrix" }, h("tbody", {}, matrix.map((row) => h("tr", {}, row.map((value) => h("td", {}, value.toPrecision(6)))))))],
    model?.translation && [h("h2", {}, "Direction to the near camera"), h("table", { class: "matrix" }, h("tbody", {}, h("tr", {}, model.translation.map((value) => h("td", {}, value.toPrecision(6))))))],
    found.footprint && [h("h2", {}, "Outline in the far image"),
      h("table", { class: "matrix" }, h("tbody", {}, found.footprint.map((corner) => h("tr", {}, corner.map((value) => h("td", {}, value.toFixed(1)))))))],
    h("h2", {}, "Seconds"),
    h("table", { class: "matrix" }, h("tbody", {}, Object.entries(found.seconds).map(([stage, value]) => h("tr", {}, h("th", { scope: "row" }, stage), h("td", {}, value.toFixed(2)))))));
}

/** The matches of the step that the viewer shows: of a failure the best step. */
function agreeing({ localization, steps }) {
  const shown = steps.find((each) => each.answer) ?? steps[0];
  if (!shown) return ["Matches that agree", `${localization.inliers} of ${localization.matches}`];
  return [localization.status === "localized" ? "Matches that agree" : "Most that agree", `${shown.agreeing} of ${shown.matches}`];
}

/** How many areas of the images were left out, in words; empty where none was. */
function masked(request) {
  const parts = [["far", request.far_mask ?? []], ["near", request.near_mask ?? []]].filter(([, areas]) => areas.length);
  return parts.map(([role, areas]) => `${areas.length} ${areas.length === 1 ? "area" : "areas"} of the ${role} image`).join(", ");
}

async function annotate(job) {
  try {
    const opened = await post("/api/annotations", { far: job.request.far, near: job.request.near });
    location.hash = `#/annotate/${opened.annotation.id}`;
  } catch (error) {
    toast(error.message, "error");
  }
}
