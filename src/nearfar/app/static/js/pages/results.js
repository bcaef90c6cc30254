/** The rows of a benchmark run, failures first; each opens in the viewer. */

import { get, post } from "../api.js";
import { fill, formatNumber, formatSeconds, h, icon, toast } from "../dom.js";
import { exportButton } from "../export-menu.js";
import { pickFolder } from "../file-picker.js";
import { facts, notice } from "../job-view.js";
import { PairViewer } from "../pair-viewer.js";
import { setShortcuts } from "../shortcuts.js";
import { stepName } from "../wording.js";

const PAGE = 150;
const COLUMNS = [
  ["outcome", "Outcome", (row) => outcome(row).rank],
  ["case", "Case", (row) => row.case],
  ["method", "Method", (row) => row.method],
  ["true_scale_change", "Scale", (row) => row.true_scale_change],
  ["error", "Error", (row) => row.error],
  ["confidence", "Confidence", (row) => row.confidence],
  ["inliers", "Agree", (row) => row.inliers],
  ["seconds", "Time", (row) => row.seconds],
];

const cache = new Map();

export async function resultsPage(main, [ref, index], signal) {
  if (!ref) await chooseRun(main);
  else {
    const run = await load(ref);
    if (signal.aborted) return;
    if (index === undefined) showTable(main, ref, run);
    else showRow(main, ref, run, Number(index));
  }
}

async function load(ref) {
  if (!cache.has(ref)) {
    cache.clear();
    cache.set(ref, await get("/api/runs", { ref }));
  }
  return cache.get(ref);
}

async function chooseRun(main) {
  cache.clear();
  const runs = await get("/api/find", { kind: "run" });
  const open = (each) => `#/results/${encodeURIComponent(each.ref)}`;
  fill(main,
    h("div", { class: "intro" }, h("h1", {}, "Benchmark results"),
      h("p", { class: "lead" }, "See which pairs failed, and why, by eye.")),
    runs.length ? h("ul", { class: "rows" }, runs.map((each) => h("li", {}, h("a", { href: open(each) }, icon("table"), h("span", { class: "pair-name" }, each.name)))))
      : h("div", { class: "empty" }, icon("table"), h("h2", {}, "There are no results yet"),
        h("p", { class: "quiet" }, "Run a benchmark, and start the app with the folders of its results and of its pairs:"),
        h("pre", {}, "nearfar bench pairs PAIRS --out RUN\nnearfar app RUN PAIRS")),
    h("div", { class: "form-row" }, h("button", { type: "button", onclick: async () => {
      const chosen = await pickFolder("Folder of results");
      if (chosen) location.hash = open(chosen);
    } }, icon("folder"), "Another folder")));
}

/** @returns {{text: string, kind: string, rank: number}} incorrect answers that look correct come first */
function outcome(row) {
  if (row.status === "error") return { text: "Error", kind: "bad", rank: 1 };
  if (row.status !== "localized") return { text: "Not found", kind: "warn", rank: 2 };
  return row.correct ? { text: "Correct", kind: "good", rank: 3 } : { text: "Incorrect", kind: "bad", rank: 0 };
}

const view = { sort: "outcome", down: false, text: "", method: "", failures: false, shown: PAGE };

function chosenRows(run) {
  const read = COLUMNS.find(([name]) => name === view.sort)[2];
  const wanted = view.text.toLowerCase();
  const rows = run.rows.map((row, index) => ({ row, index })).filter(({ row }) =>
    (!view.method || row.method === view.method) && (!view.failures || !row.correct)
    && (!wanted || `${row.case} ${row.reason ?? ""}`.toLowerCase().includes(wanted)));
  const sign = view.down ? -1 : 1;
  return rows.sort((a, b) => {
    const [x, y] = [read(a.row), read(b.row)];
    if (x === y) return a.index - b.index;
    if (x === null || x === undefined) return 1;
    if (y === null || y === undefined) return -1;
    return sign * (typeof x === "string" ? x.localeCompare(y, undefined, { numeric: true }) : x - y);
  });
}

function showTable(main, ref, run) {
  const methods = [...new Set(run.rows.map((row) => row.method))].sort();
  if (!methods.includes(view.method)) view.method = "";
  const summary = h("p", { class: "quiet" }), body = h("tbody", {}), more = h("div", { class: "form-row" });
  const search = h("input", { type: "search", placeholder: "Case or reason", value: view.text, "aria-label": "Search cases and reasons",
    oninput: () => { view.text = search.value; view.shown = PAGE; draw(); } });
  const head = h("tr", {}), units = run.rows.some((row) => row.model === "pose") ? "°" : "px";
  const drawHead = () => fill(head, COLUMNS.map(([name, text], i) => h("th", { scope: "col", class: i > 2 ? "number" : "",
    "aria-sort": view.sort === name ? (view.down ? "descending" : "ascending") : "none" },
  h("button", { type: "button", class: "sort", onclick: () => {
    view.down = view.sort === name && !view.down;
    view.sort = name;
    drawHead();
    draw();
    head.querySelectorAll("button")[i].focus();
  } }, name === "error" ? `Error, ${units}` : text))));
  const draw = () => {
    const rows = chosenRows(run), correct = rows.filter(({ row }) => row.correct).length;
    summary.textContent = `${correct} of ${rows.length} correct` + (run.skipped ? `; ${run.skipped} damaged lines left out` : "") + (run.complete ? "" : "; only the first rows are shown");
    fill(body, rows.length ? rows.slice(0, view.shown).map(({ row, index }) => tableRow(ref, row, index))
      : h("tr", {}, h("td", { colSpan: COLUMNS.length, class: "quiet" }, "No row fits.")));
    fill(more, rows.length > view.shown && h("button", { type: "button", onclick: () => { view.shown += PAGE; draw(); } }, `Show more of ${rows.length}`));
  };
  setShortcuts("Results", [{ key: "/", label: "/", what: "search", act: () => search.focus() }]);
  fill(main,
    h("div", { class: "page-head" }, h("a", { class: "back", href: "#/results" }, "All results"), h("div", {}, h("h1", {}, run.name), summary)),
    h("div", { class: "form-row filters" }, search,
      h("select", { "aria-label": "Method", onchange: (event) => { view.method = event.target.value; view.shown = PAGE; draw(); } },
        h("option", { value: "" }, "All methods"), methods.map((each) => h("option", { value: each, selected: each === view.method }, each))),
      h("label", { class: "check" }, h("input", { type: "checkbox", checked: view.failures, onchange: (event) => { view.failures = event.target.checked; draw(); } }), "Failures only")),
    h("div", { class: "table-frame", tabindex: "0", role: "region", "aria-label": "Rows" },
      h("table", { class: "results" }, h("thead", {}, head), body)), more,
    run.commands.length > 0 && h("details", {}, h("summary", {}, "How these came about"), h("pre", {}, run.commands.join("\n"))));
  drawHead();
  draw();
}

function tableRow(ref, row, index) {
  const { text, kind } = outcome(row);
  const number = (value, digits) => h("td", { class: "number" }, value === null ? "–" : value.toFixed(digits));
  return h("tr", {},
    h("td", {}, h("span", { class: `badge ${kind}` }, text)),
    h("td", {}, h("a", { href: `#/results/${encodeURIComponent(ref)}/${index}` }, row.case), row.reason && h("span", { class: "reason", title: row.reason }, row.reason)),
    h("td", {}, row.method), number(row.true_scale_change, 2), number(row.error, 2), number(row.confidence, 2),
    h("td", { class: "number" }, row.inliers === null ? "–" : `${row.inliers}/${row.matches}`),
    h("td", { class: "number" }, formatSeconds(row.seconds)));
}

function showRow(main, ref, run, index) {
  const row = run.rows[index];
  if (!row) throw new Error("There is no such row.");
  const order = chosenRows(run).map((each) => each.index), at = order.indexOf(index);
  const to = (step) => order[at + step] !== undefined && at >= 0 ? `#/results/${encodeURIComponent(ref)}/${order[at + step]}` : null;
  const viewer = new PairViewer(), { text, kind } = outcome(row);
  const go = (step) => { if (to(step)) location.hash = to(step); };
  setShortcuts("Viewer", [...viewer.shortcuts,
    { key: "j", label: "j", what: "next row", act: () => go(1) },
    { key: "b", label: "b", what: "row before", act: () => go(-1) }]);
  const link = (step, label) => (to(step) ? h("a", { class: "button", href: to(step) }, label) : h("span", { class: "button", "aria-disabled": "true" }, label));
  const again = async () => {
    try {
      const job = await post("/api/jobs", { kind: "localize", far: row.far, near: row.near, model: row.model === "fundamental" ? "fundamental" : "homography" });
      location.hash = `#/localize/${job.id}`;
    } catch (error) {
      toast(error.message, "error");
    }
  };
  fill(main,
    h("div", { class: "page-head" }, h("a", { class: "back", href: `#/results/${encodeURIComponent(ref)}` }, run.name),
      h("div", {}, h("h1", {}, row.case), h("span", { class: `badge ${kind}` }, text)),
      h("div", { class: "steps" }, link(-1, "Before"), link(1, "Next"))),
    h("div", { class: "with-side" }, viewer.element, h("aside", { class: "side", "aria-label": "Row" },
      row.reason && h("p", {}, row.reason),
      facts([
        ["Method", row.method], ["Error", row.error === null ? "–" : `${formatNumber(row.error)} ${row.model === "pose" ? "°" : "px"}`],
        ["True scale change", row.true_scale_change === null ? "–" : `${formatNumber(row.true_scale_change)}×`],
        ["Scale change found", row.scale_change === null ? "–" : `${formatNumber(row.scale_change)}×`],
        ["Confidence", formatNumber(row.confidence)],
        ["Matches that agree", row.inliers === null ? "–" : `${row.inliers} of ${row.matches}`],
        row.step && ["Found by", stepName(row.step)], ["Time", formatSeconds(row.seconds)],
      ]),
      row.licence && h("p", { class: "quiet small" }, `Images: ${row.licence}`),
      (!row.far || !row.near) && notice("The images are elsewhere", "Start nearfar app with the folder of the benchmark's images as well to see them.", null, "quiet"),
      row.far && row.near && h("div", { class: "side-actions" },
        exportButton("/api/runs", { ref, index, case: row.case, method: row.method }),
        row.model !== "pose" && h("button", { type: "button", onclick: again }, icon("again"), "Localize, to see the matches")))));
  viewer.show({ far: row.far, near: row.near, homography: row.homography, steps: [], landmarks: [], scaleChange: row.scale_change });
}
