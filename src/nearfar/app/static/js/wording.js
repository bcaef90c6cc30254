/** Plain words for the names of stages, steps, efforts and formats. */

const STAGES = {
  reading: "Reading the images",
  points: "Finding points",
  "point matching": "Comparing points",
  estimation: "Fitting a model",
  votes: "Counting votes for a place",
  "landmark search": "Searching for the near image",
  zoom: "Zooming in and looking again",
  views: "Trying simulated views",
  windows: "Searching parts of the far image",
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

const EFFORTS = {
  points: "Points only",
  landmarks: "Up to the landmark search",
  zoom: "Up to zooming in",
  views: "Everything",
};

const FORMATS = {
  colmap: "COLMAP database",
  csv: "Matches as CSV",
  geojson: "Outline as GeoJSON",
  geopackage: "Outline as GeoPackage",
  geotiff: "Warped image as GeoTIFF",
  "world-file": "Warped image with world file",
  kml: "Google Earth overlay as KML",
  kmz: "Google Earth overlay as KMZ",
  "gdal-gcps": "Control points for GDAL",
  "qgis-points": "Control points for QGIS",
  odm: "Control points for OpenDroneMap",
  hloc: "Matches for hloc",
  kitti: "Poses as in KITTI",
  "opencv-yaml": "YAML for OpenCV",
  png: "Figure as PNG",
  svg: "Figure as SVG",
  tum: "Poses as in TUM",
};

const TRACK_FORMATS = {
  csv: "Table as CSV",
  geojson: "Track as GeoJSON",
  geopackage: "Track as GeoPackage",
  gpx: "Track as GPX",
  png: "Picture of the path as PNG",
  sheet: "Contact sheet as PNG",
};

const capitalized = (name) => name.charAt(0).toUpperCase() + name.slice(1);
export const effortName = (name) => EFFORTS[name] ?? capitalized(name);
export const formatName = (name) => FORMATS[name] ?? name;
export const trackFormatName = (name) => TRACK_FORMATS[name] ?? formatName(name);
export const stageName = (name) => STAGES[name] ?? capitalized(name);
export const stepName = (name) => STEPS[name] ?? capitalized(name);

export const STATUS = {
  waiting: "Waiting",
  running: "Running",
  done: "Done",
  error: "Error",
  cancelled: "Cancelled",
  interrupted: "Interrupted",
};

/** What a job's state is called and coloured like. */
export function jobState(job) {
  if (job.status === "done") return job.found ? [job.request.kind === "localize" ? "Localized" : "Found", "good"] : ["Not found", "warn"];
  const kinds = { waiting: "quiet", running: "busy", error: "bad", cancelled: "quiet", interrupted: "warn" };
  return [STATUS[job.status], kinds[job.status]];
}

const pixels = (value) => `${value < 0.1 ? "< 0.1" : value < 100 ? Number(value.toFixed(1)) : Math.round(value)} px`;
const degrees = (value) => `${Number(value.toPrecision(2))}°`;

/**
 * The error that an answer is expected to have, in words; empty where it is not known.
 * @param {{mean: number|null, corners: number[]|null, rotation: number|null, direction: number|null}|null} expected
 * @param {boolean} brief whether a column's title tells what the numbers are
 */
export function expectedError(expected, brief = false) {
  if (!expected) return "";
  if (expected.mean === null) return `${degrees(expected.rotation)} in the rotation, ${degrees(expected.direction)} in the direction`;
  const worst = expected.corners && pixels(Math.max(...expected.corners));
  return `${pixels(expected.mean)}${brief ? "" : " in the mean"}${worst ? `, up to ${worst}${brief ? "" : " at a corner"}` : ""}`;
}
