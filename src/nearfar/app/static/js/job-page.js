/** The page of one job: its name and state, its progress while it runs, then its answer. */

import { fill, h, toast } from "./dom.js";
import { Running, badge, cancelJob, follow, notice, startAgain, stopped } from "./job-view.js";
import { jobState } from "./wording.js";

/**
 * @param {HTMLElement} main
 * @param {string} id of the job
 * @param {AbortSignal} signal that the page is left
 * @param {{href: string, text: string}} back
 * @param {(job: object, again: () => void) => Node} answer builds what is shown of a job that is done
 */
export async function showJob(main, id, signal, back, answer) {
  const heading = h("div", {}), said = h("p", { class: "visually-hidden", role: "status" }), body = h("div", { class: "job-body" });
  fill(main, h("div", { class: "page-head" }, h("a", { class: "back", href: back.href }, back.text), heading), said, body);
  const complain = (error) => toast(error.message, "error");
  const again = () => startAgain(id).then(watch, complain);
  const cancel = () => cancelJob(id).catch(complain);
  const running = new Running(cancel);
  let shown = "";
  const show = (key, build) => {
    if (key === shown) return;
    const held = body.contains(document.activeElement);
    shown = key;
    fill(body, build());
    if (held) document.getElementById("main").focus({ preventScroll: true });
  };
  const watch = () => follow(id, (job, error) => {
    if (error) {
      heading.querySelector(".badge")?.replaceWith(h("span", { class: "badge bad" }, error.status === 404 ? "Gone" : "No connection"));
      show(error.message, () => notice(error.status === 404 ? "This job is gone" : "No connection", error.message, null, "bad"));
      return;
    }
    fill(heading, h("h1", {}, job.names.at(-1), h("span", { class: "quiet" }, " in "), job.names[0]), badge(job));
    if (!["waiting", "running"].includes(job.status)) said.textContent = `${jobState(job)[0]}: ${job.names.at(-1)} in ${job.names[0]}`;
    if (job.status === "done") show("done", () => answer(job, again));
    else if (job.status === "running") {
      running.update(job);
      show("running", () => running.element);
    } else show(job.status, () => stopped(job, again, cancel));
  }, signal);
  await watch();
}
