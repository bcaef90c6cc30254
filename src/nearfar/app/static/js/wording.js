/** Plain words for the names of stages and steps. */

const STAGES = {
  reading: "Reading the images",
  points: "Finding points",
  "point matching": "Comparing points",
  estimation: "Fitting a model",
  votes: "Counting votes for a place",
  "landmark search": "Searching for the near image",
  zoom: "Zooming in and looking again",
  views: "Trying views from aside",
  "searching the map": "Searching the map",
};

const STEPS = {
  points: "Points",
  votes: "Votes",
  landmarks: "Landmark search",
  alignment: "Alignment of places",
  views: "Views of whole images",
  expected: "Voted place",
};

const FORMATS = {
  colmap: "COLMAP database",
  csv: "Matches as CSV",
  geojson: "Outline as GeoJSON",
  hloc: "Matches for hloc",
  kitti: "Poses as in KITTI",
  "opencv-yaml": "YAML for OpenCV",
  png: "Figure as PNG",
  svg: "Figure as SVG",
  tum: "Poses as in TUM",
};

export const formatName = (name) => FORMATS[name] ?? name;
export const stageName = (name) => STAGES[name] ?? name.charAt(0).toUpperCase() + name.slice(1);
export const stepName = (name) => STEPS[name] ?? name.charAt(0).toUpperCase() + name.slice(1);

export const STATUS = {
  waiting: "Waiting",
  running: "Running",
  done: "Done",
  failed: "Error",
  cancelled: "Cancelled",
  interrupted: "Interrupted",
};

/** What a job's state is called and coloured like. */
export function jobState(job) {
  if (job.status === "done") return job.found ? ["Found", "good"] : ["Not found", "warn"];
  const kinds = { waiting: "quiet", running: "busy", failed: "bad", cancelled: "quiet", interrupted: "warn" };
  return [STATUS[job.status], kinds[job.status]];
}

export const EFFORTS = [
  ["views", "Everything", "half a minute at most where nothing is found"],
  ["zoom", "Up to zooming in", "a few seconds"],
  ["landmarks", "Up to the landmark search", ""],
  ["points", "Points only", "the fastest"],
];
