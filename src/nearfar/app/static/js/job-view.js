/** A job: its progress by step while it runs, then what it found. */

import { get, pictureAddress, post } from "./api.js";
import { fill, formatSeconds, h } from "./dom.js";
import { jobState, stageName, stepName } from "./wording.js";

const EVERY = 400;
const EVERY_WHEN_LOST = 2000;

/** Ask for a job again and again until it has ended or the signal is aborted. */
export async function follow(id, onChange, signal) {
  while (!signal.aborted) {
    let wait = EVERY;
    try {
      const job = await get(`/api/jobs/${id}`);
      if (signal.aborted) return;
      onChange(job, null);
      if (!["waiting", "running"].includes(job.status)) return;
    } catch (error) {
      if (signal.aborted) return;
      onChange(null, error);
      if (error.status === 404) return;
      wait = EVERY_WHEN_LOST;
    }
    await new Promise((resolve) => setTimeout(resolve, wait));
  }
}

export function badge(job) {
  const [text, kind] = jobState(job);
  return h("span", { class: `badge ${kind}` }, text);
}

/** What is shown of a job that waits, or has ended without an answer. */
export function stopped(job, again, cancel) {
  if (job.status === "waiting") {
    return notice("Waiting for its turn", "Jobs are done one after the other.", h("button", { type: "button", onclick: cancel }, "Cancel"), "busy");
  }
  const restart = h("button", { type: "button", class: "primary", onclick: again }, "Start again");
  if (job.status === "interrupted") {
    return notice("Interrupted", "The server ended before this job did. Nothing else is lost.", restart, "warn");
  }
  if (job.status === "cancelled") return notice("Cancelled", "This job was cancelled.", restart, "quiet");
  return notice("This could not be done", job.error, restart, "bad");
}

/** A job that runs. Its parts change and its buttons stay, so that they can be used meanwhile. */
export class Running {
  constructor(cancel) {
    this.stage = h("h2", { role: "status" });
    this.clock = h("span", { class: "quiet" });
    this.stages = h("ol", { class: "stages" });
    this.steps = h("div", {});
    this.images = h("div", { class: "previews" });
    this.element = h("div", { class: "progress" },
      h("header", {}, h("span", { class: "spinner" }), this.stage, this.clock, h("button", { type: "button", onclick: cancel }, "Cancel")),
      h("div", { class: "progress-body" }, h("div", {}, this.stages, this.steps), this.images));
  }

  update(job) {
    if (!this.images.hasChildNodes()) {
      const { far, near, query } = job.request;
      fill(this.images, [far, near, query].filter(Boolean).map((ref) => h("img", { src: pictureAddress(ref, true), alt: "" })));
    }
    const stage = job.stage ? stageName(job.stage) : "Starting";
    if (this.stage.textContent !== stage) this.stage.textContent = stage;
    this.clock.textContent = formatSeconds(Math.max(0, Date.now() / 1000 - job.started));
    const state = JSON.stringify([job.stage, job.stages, job.steps]);
    if (state === this.state) return;
    this.state = state;
    fill(this.stages, job.stages.map((each) => h("li", { class: each === job.stage ? "now" : "done" }, stageName(each))));
    fill(this.steps, job.steps.length > 0 && h("table", { class: "plain" },
      h("caption", {}, "Best so far"),
      h("thead", {}, h("tr", {}, ["Step", "Matches", "Agree"].map((text, i) => h("th", { scope: "col", class: i ? "number" : "" }, text)))),
      h("tbody", {}, job.steps.map((each) => h("tr", {},
        h("th", { scope: "row" }, stepName(each.name)), h("td", { class: "number" }, each.matches), h("td", { class: "number" }, each.agreeing))))));
  }
}

export function notice(title, text, action, kind = "quiet") {
  return h("div", { class: `notice ${kind}`, role: kind === "bad" || kind === "warn" ? "alert" : "status" },
    h("div", {}, h("h2", {}, title), text && h("p", {}, text)), action);
}

export const startAgain = (id) => post(`/api/jobs/${id}/start`);
export const cancelJob = (id) => post(`/api/jobs/${id}/cancel`);

/** Facts as a list of names and values. */
export function facts(entries) {
  return h("dl", { class: "facts" }, entries.filter(Boolean).map(([name, value, extra]) =>
    h("div", {}, h("dt", {}, name), h("dd", {}, value, extra))));
}

/** Near certainty is told apart from certainty, which there is none of. */
export function confidenceText(value) {
  if (value === null || value === undefined) return "–";
  return value > 0.9995 ? "> 99.9 %" : `${(value * 100).toFixed(value > 0.99 ? 1 : 0)} %`;
}

export function confidenceMeter(value) {
  if (value === null || value === undefined) return null;
  const bar = h("span", { class: "meter-bar" });
  bar.style.width = `${Math.round(value * 100)}%`;
  const kind = value >= 0.9 ? "good" : value >= 0.5 ? "fair" : "low";
  return h("span", { class: `meter ${kind}`, role: "img", "aria-label": confidenceText(value) }, bar);
}
