/** Requests to the server. */

export class RequestError extends Error {
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

const RETRIES = 4;

async function answered(path, options = {}) {
  for (let attempt = 0; ; attempt++) {
    let response;
    try {
      response = await fetch(path, options);
    } catch (error) {
      if (options.signal?.aborted) throw error;
      throw new RequestError(0, "The server does not answer. Is nearfar app still running?");
    }
    if (response.status === 503 && attempt < RETRIES) {
      await new Promise((resolve) => setTimeout(resolve, 400 * 2 ** attempt));
      continue;
    }
    if (response.ok) return response;
    let detail = `The server answered with status ${response.status}.`;
    try {
      detail = (await response.json()).detail;
    } catch { /* keep the status */ }
    throw new RequestError(response.status, sentence(String(detail)));
  }
}

async function request(path, options) {
  const response = await answered(path, options);
  return response.status === 204 ? null : response.json();
}

/** Names of files keep their letters as they are. */
function sentence(text) {
  const [first] = text.split(/\s/, 1);
  const upper = /^[a-z]+,?$/.test(first) ? text.charAt(0).toUpperCase() + text.slice(1) : text;
  return /[.!?]$/.test(upper) ? upper : `${upper}.`;
}

export const get = (path, parameters = {}) => {
  const query = new URLSearchParams(parameters).toString();
  return request(query ? `${path}?${query}` : path);
};

/** Save the file that the server answers with, under the name that it gives it. */
export async function save(path, parameters) {
  const response = await answered(`${path}?${new URLSearchParams(parameters)}`);
  const [, name] = /filename="(.+)"/.exec(response.headers.get("Content-Disposition"));
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await response.blob());
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

const send = (method) => (path, body) => request(path, {
  method,
  headers: { "Content-Type": "application/json" },
  body: JSON.stringify(body ?? {}),
});

export const post = send("POST");
export const put = send("PUT");
export const remove = (path) => request(path, { method: "DELETE" });

/** Send an image file; the answer has its reference, name and size. */
export function sendImage(file) {
  const query = new URLSearchParams({ name: file.name || "image" });
  return request(`/api/images?${query}`, {
    method: "POST",
    headers: { "Content-Type": "application/octet-stream" },
    body: file,
  });
}

export const imageInfo = (ref) => get("/api/images/info", { ref });

export function pictureAddress(ref, thumbnail = false) {
  return `/api/images/picture?${new URLSearchParams(thumbnail ? { ref, thumbnail: "true" } : { ref })}`;
}

export const tileAddress = (ref, level, column, row) => `/api/images/tile?${new URLSearchParams({ ref, level, column, row })}`;

/** A picture that can be given up while it is loaded; asked for again where the server is busy. */
export async function fetchPicture(address, signal) {
  const response = await answered(address, { signal });
  return createImageBitmap(await response.blob());
}

export function warpedAddress(ref, homography, width, height) {
  const query = new URLSearchParams({ ref, width, height });
  for (const value of homography.flat()) query.append("h", value);
  return `/api/images/warped?${query}`;
}

/** An image that is loaded and decoded. */
export function loadPicture(address) {
  return new Promise((resolve, reject) => {
    const image = new Image();
    image.decoding = "async";
    image.onload = () => resolve(image);
    image.onerror = () => reject(new RequestError(0, "The picture could not be loaded."));
    image.src = address;
  });
}
