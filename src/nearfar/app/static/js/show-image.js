/** Show an image of the server in a view: its picture, and parts of it where the picture is reduced. */

import { imageInfo, loadPicture, pictureAddress } from "./api.js";
import { TileLayer } from "./tile-layer.js";

/**
 * @param {import("./canvas-view.js").CanvasView} view
 * @param {string} ref
 * @param {(info: {name: string, width: number, height: number}) => boolean} [stillWanted] is asked
 *   before the view changes; false leaves it
 * @returns {Promise<number[]|null>} the size of the image; null where it is not wanted any more
 */
export async function showImage(view, ref, stillWanted = () => true) {
  const info = await imageInfo(ref);
  if (!stillWanted(info)) return null;
  const picture = await loadPicture(pictureAddress(ref));
  if (!stillWanted(info)) return null;
  const tiles = info.tiles ? new TileLayer(info, () => view.redraw(), (message) => { view.message.textContent = message; }) : null;
  view.show(picture, [info.width, info.height], tiles);
  return [info.width, info.height];
}
