/** A folder of close-ups on one overview: a table that fills as it runs, failures first. */

import { get, post, remove } from "../api.js";
import { confirmed, fill, formatSeconds, formatTime, h, icon, iconButton, toast } from "../dom.js";
import { exportButton } from "../export-menu.js";
import { pickFolder } from "../file-picker.js";
import { ImageSlot } from "../image-slot.js";
import { badge, notice } from "../job-view.js";
import { keptNote } from "../kept-note.js";
import { matcherChoice } from "../matcher-choice.js";
import { setShortcuts } from "../shortcuts.js";
import { effortName, expectedError, stageName } from "../wording.js";
import { worldLink } from "./world.js";

const EVERY = 1000;

export async function batchPage(main, [id], signal) {
  if (id) await table(main, id, signal);
  else await start(main);
}

async function start(main) {
  const about = await get("/api/about"), { efforts, matchers, devices } = about;
  const slot = new ImageSlot("Far image", "The overview in which all close-ups are looked for.", true);
  let folder = null;
  const name = h("p", { class: "quiet", role: "status" }, "No folder is chosen.");
  const pick = h("button", { type: "button", id: "batch-folder", onclick: async () => {
    folder = (await pickFolder("Folder of close-ups")) ?? folder;
    if (folder) name.textContent = folder.name;
    ready();
  } }, icon("folder"), "Choose a folder");
  const model = h("select", { id: "model" }, h("option", { value: "homography" }, "Flat scene, or camera that only turned"), h("option", { value: "fundamental" }, "Scene with depth"));
  const effort = h("select", { id: "effort" }, efforts.reverse().map((value) => h("option", { value }, effortName(value))));
  const choice = matcherChoice(matchers, devices);
  const submit = async () => {
    if (go.disabled) return;
    go.disabled = true;
    try {
      const batch = await post("/api/batches", { far: slot.image.ref, folder: folder.ref, model: model.value, max_effort: effort.value, ...choice.chosen, far_mask: slot.areas });
      location.hash = `#/batch/${batch.id}`;
    } catch (error) {
      toast(error.message, "error");
      ready();
    }
  };
  const go = h("button", { type: "button", class: "primary large", id: "batch", disabled: true, onclick: submit }, "Localize all");
  const ready = () => { go.disabled = !slot.image || !folder; };
  slot.addEventListener("change", ready);
  setShortcuts("Batch", [{ key: "Enter", label: "Enter", what: "localize all", act: submit }]);
  const recent = h("section", { class: "recent" });
  fill(main, h("div", { class: "intro" }, h("h1", {}, "Where do all the close-ups lie?"),
    h("p", { class: "lead" }, "Give an overview and a folder of close-ups. Each is looked for in the overview, one after the other.")),
  h("div", { class: "slots two" }, slot.element, h("section", { class: "panel" }, h("h2", {}, "Folder of close-ups"), name, h("div", {}, pick))),
  h("div", { class: "form-row" }, h("label", { class: "field", for: "model" }, "What the images show", model),
    h("label", { class: "field", for: "effort" }, "How much to try", effort), go),
  choice.element, keptNote(about), recent);
  showRecent(recent);
}

async function showRecent(element) {
  const batches = new Map();
  for (const job of await get("/api/jobs")) if (job.batch) batches.set(job.batch, [...(batches.get(job.batch) ?? []), job]);
  if (!batches.size) return;
  fill(element, h("h2", {}, "Recent"), h("ul", { class: "rows" }, [...batches].map(([id, jobs]) => h("li", {},
    h("a", { href: `#/batch/${id}` }, h("span", { class: "pair-name" }, `${jobs.length} close-ups`, h("span", { class: "quiet" }, " in "), jobs[0].names[0]),
      h("span", { class: "quiet" }, counted(jobs)), h("time", { class: "quiet" }, formatTime(jobs[0].created))),
    iconButton("trash", `Delete ${jobs.length} close-ups in ${jobs[0].names[0]}`, async () => {
      if (await confirmed("Delete this batch?", "Its answers are deleted with it. The images stay.", "Delete")) {
        for (const job of jobs) await remove(`/api/jobs/${job.id}`);
        showRecent(fill(element));
      }
    })))));
}

const active = (job) => ["waiting", "running"].includes(job.status);

function counted(jobs) {
  const number = (test) => jobs.filter(test).length, errors = number((job) => job.status === "error");
  const missed = number((job) => job.status === "done" && !job.found), left = number(active);
  const stopped = number((job) => ["cancelled", "interrupted"].includes(job.status));
  return [`${number((job) => job.found)} localized`, missed && `${missed} not found`, errors && `${errors} ${errors === 1 ? "error" : "errors"}`,
    stopped && `${stopped} stopped`, left && `${left} to do`].filter(Boolean).join(", ");
}

async function table(main, id, signal) {
  const summary = h("p", { class: "quiet", role: "status" }), body = h("tbody", {}), heading = h("h1", {}, "Batch");
  const stop = h("button", { type: "button", onclick: () => post(`/api/batches/${id}/cancel`).then(show, complain) }, "Cancel");
  const complain = (error) => toast(error.message, "error");
  const save = (layout, text) => h("a", { class: "button", href: `/api/batches/${id}/export?layout=${layout}`, download: `batch.${layout}` }, icon("download"), text);
  let shown = "";
  const show = ({ jobs }) => {
    const state = JSON.stringify(jobs.map((job) => [job.id, job.status, job.stage]));
    if (state === shown) return;
    shown = state;
    fill(heading, `${jobs.length} close-ups`, h("span", { class: "quiet" }, " in "), jobs[0].names[0]);
    summary.textContent = counted(jobs);
    stop.hidden = !jobs.some(active);
    const held = body.contains(document.activeElement) ? document.activeElement.getAttribute("href") : null;
    fill(body, jobs.map(row));
    if (held) body.querySelector(`a[href="${held}"]`)?.focus();
  };
  fill(main, h("div", { class: "page-head" }, h("a", { class: "back", href: "#/batch" }, "New batch"), h("div", {}, heading, summary)),
    h("div", { class: "form-row filters" }, stop, save("csv", "All as CSV"), save("jsonl", "All as JSON lines"), exportButton(`/api/batches/${id}/answers`, {}, "Export all as …"), worldLink("batch", id)),
    h("div", { class: "table-frame", tabindex: "0", role: "region", "aria-label": "Close-ups" },
      h("table", { class: "results" }, h("thead", {}, h("tr", {}, ["State", "Close-up", "Answer", "Expected error", "Time"].map((text, i) => h("th", { scope: "col", class: i > 3 ? "number" : "", title: text === "Expected error" ? "Mean over the close-up, and the worst corner" : null }, text)))), body)));
  while (!signal.aborted) {
    try {
      const batch = await get(`/api/batches/${id}`);
      if (signal.aborted) return;
      show(batch);
      if (!batch.jobs.some(active)) return;
    } catch (error) {
      if (signal.aborted) return;
      if (error.status === 404) { fill(main, notice("This batch is gone", error.message, null, "bad")); return; }
      summary.textContent = error.message;
    }
    await new Promise((resolve) => setTimeout(resolve, EVERY));
  }
}

function row(job) {
  return h("tr", {}, h("td", {}, badge(job)), h("td", {}, h("a", { href: `#/localize/${job.id}` }, job.names[1])),
    h("td", { class: "told" }, said(job), job.warning && h("span", { class: "caution small" }, icon("alert"), job.warning)),
    h("td", {}, expectedError(job.expected_error, true) || "–"),
    h("td", { class: "number" }, job.started && job.ended ? formatSeconds(job.ended - job.started) : "–"));
}

/** What there is to say of a job in one cell. */
function said(job) {
  if (job.status === "running") return job.stage ? stageName(job.stage) : "";
  return job.error || job.explanation || job.summary;
}
