/** A camera that is followed through an image or a map, as a job; and tracks that were saved. */

import { get, post, remove } from "../api.js";
import { cameraChoice } from "../camera-choice.js";
import { confirmed, fill, formatSeconds, formatTime, h, icon, iconButton, toast } from "../dom.js";
import { exportButton } from "../export-menu.js";
import { pickFolder, pickFrames } from "../file-picker.js";
import { ImageSlot } from "../image-slot.js";
import { badge, cancelJob, follow, notice, startAgain, stopped } from "../job-view.js";
import { setShortcuts } from "../shortcuts.js";
import { TrackView } from "../track-view.js";
import { jobState, stageName, trackFormatName } from "../wording.js";

const LOOKED_AT_EVERY = 1500;

export async function trackPage(main, [first, ref], signal) {
  if (!first) await start(main);
  else if (first === "saved") await showSaved(main, ref, signal);
  else await showTrackJob(main, first, signal);
}

async function start(main) {
  const [about, maps, saved] = await Promise.all([get("/api/about"), get("/api/find", { kind: "map" }), get("/api/find", { kind: "track" })]);
  const intro = h("div", { class: "intro" }, h("h1", {}, "Where did the camera go?"),
    h("p", { class: "lead" }, "Give an overview, and a video or a folder of frames in the order of their names. Each frame is found from the ones before."));
  const recent = h("section", { class: "recent" });
  if (about.maps) {
    fill(main, intro, h("div", { class: "empty" }, icon("route"), h("h2", {}, "Tracks need a further package"), h("p", { class: "quiet" }, about.maps)), savedTracks(saved));
    return;
  }
  const slot = new ImageSlot("Far image", "The overview over which the camera moves.");
  const where = h("select", { id: "where", onchange: () => { slot.element.hidden = where.value !== ""; onMap.hidden = where.value === ""; ready(); } },
    h("option", { value: "" }, "One far image"), maps.map((each) => h("option", { value: each.ref }, `Map ${each.name}`)));
  const onMap = h("div", { class: "empty", hidden: true }, icon("map"), h("p", { class: "quiet" }, "The frames are followed in all images of the map."));
  const frames = frameChoice(() => ready());
  const camera = cameraChoice("frame-camera", "Camera of the frames", ["none", "given"], () => ready());
  const fps = h("input", { type: "text", id: "fps", inputmode: "decimal", placeholder: "as they come", size: "10", oninput: () => ready() });
  const smooth = h("input", { type: "checkbox", id: "smooth" });
  const go = h("button", { type: "button", class: "primary large", id: "follow", disabled: true, onclick: () => submit() }, "Follow");
  const rate = () => (fps.value.trim() ? Number(fps.value.replace(",", ".")) : null);
  const ready = () => { go.disabled = !(where.value || slot.image) || !frames.chosen || !camera.complete || (rate() !== null && !(rate() > 0)); };
  const submit = async () => {
    if (go.disabled) return;
    go.disabled = true;
    try {
      const job = await post("/api/jobs", { kind: "track", far: where.value || slot.image.ref, frames: frames.chosen.ref, fps: rate(), camera: camera.value, smooth: smooth.checked });
      location.hash = `#/track/${job.id}`;
    } catch (error) {
      toast(error.message, "error");
      ready();
    }
  };
  slot.addEventListener("change", ready);
  setShortcuts("Track", [{ key: "Enter", label: "Enter", what: "follow", act: submit }]);
  fill(main, intro, h("div", { class: "form-row" }, h("label", { class: "field", for: "where" }, "Follow the camera in", where)),
    h("div", { class: "slots two track-slots" }, h("div", {}, slot.element, onMap), frames.element),
    h("div", { class: "form-row track-options" }, h("label", { class: "field", for: "fps" }, "Frames a second", fps), camera.element,
      h("label", { class: "check", for: "smooth" }, smooth, "Smooth the path at the end"), go),
    recent, savedTracks(saved));
  showRecent(recent);
}

function frameChoice(changed) {
  let chosen = null;
  const name = h("p", { class: "quiet", role: "status" }, "Nothing is chosen.");
  const pick = h("button", { type: "button", id: "frames", onclick: async () => {
    chosen = (await pickFrames("Video, or folder of frames")) ?? chosen;
    if (chosen) name.textContent = chosen.name;
    changed();
  } }, icon("folder"), "Choose a video or a folder");
  const element = h("section", { class: "panel" }, h("h2", {}, "Frames"), name, h("div", {}, pick),
    h("p", { class: "quiet small" }, "They must lie in a folder that nearfar app was started with."));
  return { element, get chosen() { return chosen; } };
}

function savedTracks(saved) {
  const open = (ref) => `#/track/saved/${encodeURIComponent(ref)}`;
  return h("section", { class: "recent" }, h("h2", {}, "Saved by nearfar map track"),
    saved.length > 0 && h("ul", { class: "rows" }, saved.map((each) => h("li", {}, h("a", { href: open(each.ref) }, icon("route"), h("span", { class: "pair-name" }, each.name))))),
    h("div", { class: "form-row" }, h("button", { type: "button", onclick: async () => {
      const chosen = await pickFolder("Folder of a saved track");
      if (chosen) location.hash = open(chosen.ref);
    } }, icon("folder"), saved.length ? "Another folder" : "Open a folder")));
}

async function showRecent(element) {
  const jobs = (await get("/api/jobs")).filter((job) => job.request.kind === "track").slice(0, 12);
  if (!jobs.length) return;
  fill(element, h("h2", {}, "Recent"), h("ul", { class: "rows" }, jobs.map((job) => h("li", {},
    h("a", { href: `#/track/${job.id}` }, h("span", { class: "pair-name" }, job.names[1], h("span", { class: "quiet" }, " in "), job.names[0]),
      h("span", { class: "quiet" }, job.summary), badge(job), h("time", { class: "quiet" }, formatTime(job.created))),
    iconButton("trash", `Delete ${job.names[1]} in ${job.names[0]}`, async () => {
      if (await confirmed("Delete this track?", "Its states are deleted with it. The frames stay.", "Delete")) {
        await remove(`/api/jobs/${job.id}`);
        showRecent(fill(element));
      }
    })))));
}

/** A view of a track, anew where the smoothed path is asked for. */
class Shown {
  /** @param {string} path of the track @param {object} query that tells which */
  constructor(path, query, signal) {
    Object.assign(this, { path, query, signal, smooth: false });
    this.element = h("div", { class: "track-body" });
    this.begin();
  }

  begin() {
    this.view?.stop();
    const part = this.path === "/api/tracks" ? this.path : `${this.path}/track`;
    this.view = new TrackView(() => [this.again, exportButton(part, { ...this.query, smooth: this.smooth }, "Export as …", trackFormatName), this.toggle()]);
    this.view.known = 0;
    this.part = part;
    this.again = null;
    setShortcuts("Track", this.view.shortcuts);
  }

  toggle() {
    if (!this.view.track?.smooth) return null;
    const box = h("input", { type: "checkbox", checked: this.smooth, id: "smooth", onchange: async () => {
      this.smooth = box.checked;
      this.begin();
      await this.update();
      document.getElementById("smooth")?.focus();
    } });
    return h("label", { class: "check", for: "smooth" }, box, "Smoothed path");
  }

  /** Ask for the frames that are not shown yet; nothing is shown while there are none. */
  async update() {
    const { view } = this;
    const track = await get(this.part, { ...this.query, smooth: this.smooth, start: view.known });
    if (this.signal.aborted || view !== this.view) return track;
    if (track.frames.length) {
      view.known = track.total;
      view.show(track);
      if (!this.element.contains(view.element)) fill(this.element, track.skipped > 0 && notice("Damaged lines", `${track.skipped} lines of the track could not be read and are left out.`, null, "warn"), view.element);
    }
    return track;
  }
}

async function showSaved(main, ref, signal) {
  const shown = new Shown("/api/tracks", { ref }, signal);
  const heading = h("h1", {});
  const track = await shown.update();
  if (signal.aborted) return;
  heading.textContent = track.name;
  fill(main, h("div", { class: "page-head" }, h("a", { class: "back", href: "#/track" }, "All tracks"), h("div", {}, heading, h("p", { class: "quiet" }, counted(track.frames)))),
    track.images.some((each) => !each.ref) && notice("The map is elsewhere", "Start nearfar app with the folder of the map's images as well to see the path on them.", null, "quiet"),
    track.total ? shown.element : notice("There are no frames", "The track is empty.", null, "warn"));
}

function counted(frames) {
  const found = frames.filter((each) => ["tracked", "relocalized"].includes(each.status)).length;
  return `${found} of ${frames.length} frames found`;
}

async function showTrackJob(main, id, signal) {
  const heading = h("div", {}), said = h("p", { class: "visually-hidden", role: "status" }), status = h("div", {});
  const shown = new Shown(`/api/jobs/${id}`, {}, signal);
  fill(main, h("div", { class: "page-head" }, h("a", { class: "back", href: "#/track" }, "New track"), heading), said, status, shown.element);
  const complain = (error) => toast(error.message, "error");
  const again = () => startAgain(id).then(watch, complain);
  const cancel = () => cancelJob(id).catch(complain);
  const progress = new Progress(cancel);
  let state = "", looked = 0, asking = false;
  const look = async (job) => {
    if (asking || !job.frames && job.status === "running") return;
    asking = true;
    try {
      await shown.update();
    } catch (error) {
      if (error.status !== 404) complain(error);
    }
    asking = false;
  };
  const set = (name, build) => {
    if (name === state) return;
    const held = status.contains(document.activeElement);
    state = name;
    fill(status, build());
    if (held) document.getElementById("main").focus({ preventScroll: true });
  };
  const watch = () => follow(id, (job, error) => {
    if (error) {
      set(error.message, () => notice(error.status === 404 ? "This track is gone" : "No connection", error.message, null, "bad"));
      return;
    }
    fill(heading, h("h1", {}, job.names[1], h("span", { class: "quiet" }, " in "), job.names[0]), badge(job));
    if (job.status === "running") {
      progress.update(job);
      set("running", () => progress.element);
    } else if (job.status === "done") {
      said.textContent = `${jobState(job)[0]}: ${job.summary}`;
      set("done", () => h("p", { class: "quiet" }, `${job.summary}, in ${formatSeconds(job.ended - job.started)}`));
    } else set(job.status, () => stopped(job, again, cancel));
    const over = !["waiting", "running"].includes(job.status);
    if (over || Date.now() - looked > LOOKED_AT_EVERY) {
      looked = Date.now();
      look(job).then(() => over && look(job));
    }
  }, signal);
  await watch();
}

/** How far a track is, while it runs. */
class Progress {
  constructor(cancel) {
    this.stage = h("h2", { role: "status" });
    this.clock = h("span", { class: "quiet" });
    this.bar = h("progress", { "aria-label": "Frames followed" });
    this.text = h("p", { class: "quiet" });
    this.element = h("div", { class: "progress" },
      h("header", {}, h("span", { class: "spinner" }), this.stage, this.clock, h("button", { type: "button", onclick: cancel }, "Cancel")), this.bar, this.text);
  }

  update(job) {
    const stage = job.stage ? stageName(job.stage) : "Starting";
    if (this.stage.textContent !== stage) this.stage.textContent = stage;
    this.clock.textContent = formatSeconds(Math.max(0, Date.now() / 1000 - job.started));
    const { done, total, found, lost } = job.frames ?? { done: 0, total: null, found: 0, lost: 0 };
    this.bar.hidden = total === null;
    if (total !== null) Object.assign(this.bar, { max: total, value: done });
    const predicted = done - found - lost;
    this.text.textContent = job.frames ? `${done}${total === null ? "" : ` of ${total}`} frames: ${[`${found} found`, predicted && `${predicted} predicted`, lost && `${lost} lost`].filter(Boolean).join(", ")}` : "";
  }
}
