/** The parts of an image that is too large for one picture, at the resolution at which it is looked at. */

import { tileAddress, fetchPicture } from "./api.js";

const SIDE = 512, AT_ONCE = 4, MOST_KEPT = 220, MOST_WANTED = 100;

/** Level 0 is one tile, each further level has twice the resolution; see `nearfar.app.zoom_tiles`. */
export class TileLayer {
  /**
   * @param {{ref: string, width: number, height: number, direct: number}} image
   * @param {() => void} onLoad is called when a tile has arrived
   * @param {(message: string) => void} onError is called with the reason when one cannot be made
   */
  constructor(image, onLoad, onError) {
    this.image = image;
    this.onLoad = onLoad;
    this.onError = onError;
    this.finest = Math.max(0, Math.ceil(Math.log2(Math.ceil(Math.max(image.width, image.height) / SIDE))));
    this.kept = new Map();
    this.loading = new Map();
    this.failed = new Set();
    this.waiting = [];
  }

  /** Whether all tiles that are wanted have arrived. */
  get whole() { return this.loading.size === 0 && this.waiting.length === 0; }

  /**
   * Draw what has arrived, coarse tiles first.
   * @param {{scale: number, toScreen: Function, toImage: Function, width: number, height: number}} frame
   * @param {boolean} ask whether to load what is missing
   */
  draw(context, frame, ask = true) {
    const level = this.#level(frame), wanted = this.#within(frame, level);
    const order = [...this.kept.values()].filter((tile) => tile.level <= level).sort((a, b) => a.level - b.level);
    for (const tile of order) this.#place(context, frame, tile);
    for (const tile of wanted) {  // Those used last are kept.
      const known = this.kept.get(tile.key);
      if (known && ask) { this.kept.delete(tile.key); this.kept.set(tile.key, known); }
    }
    if (ask) this.#load(wanted.filter((tile) => !this.kept.has(tile.key) && !this.failed.has(tile.key)));
  }

  close() {
    this.waiting = [];
    for (const control of this.loading.values()) control.abort();
    for (const tile of this.kept.values()) tile.picture.close();
    this.kept.clear();
  }

  /** The coarsest level that is sharp; where that one is slow to make, the one that it is made of. */
  #level(frame) {
    const ratio = window.devicePixelRatio || 1;
    const sharp = Math.min(this.finest, Math.max(0, Math.ceil(Math.log2(frame.scale * ratio) + this.finest)));
    return sharp < this.image.direct && this.#within(frame, this.image.direct).length <= MOST_WANTED ? this.image.direct : sharp;
  }

  /** The tiles of a level within a frame, those in its middle first. */
  #within(frame, level) {
    const { width, height } = this.image, across = SIDE * 2 ** (this.finest - level);
    const [left, top] = frame.toImage([0, 0]), [right, bottom] = frame.toImage([frame.width, frame.height]);
    const first = (start) => Math.max(0, Math.floor((start + 0.5) / across));
    const last = (end, size) => Math.min(Math.ceil(size / across) - 1, Math.floor((end + 0.5) / across));
    const found = [];
    for (let row = first(top); row <= last(bottom, height); row++) {
      for (let column = first(left); column <= last(right, width); column++) {
        const box = [column * across, row * across, Math.min(width, (column + 1) * across), Math.min(height, (row + 1) * across)].map((side) => side - 0.5);
        const away = Math.hypot((box[0] + box[2] - left - right) / 2, (box[1] + box[3] - top - bottom) / 2);
        found.push({ key: `${level}/${column}/${row}`, level, column, row, box, away });
      }
    }
    return found.sort((a, b) => a.away - b.away);
  }

  #place(context, frame, { box: [left, top, right, bottom], picture }) {
    const [x, y] = frame.toScreen([left, top]), [x2, y2] = frame.toScreen([right, bottom]);
    if (x2 < 0 || y2 < 0 || x > frame.width || y > frame.height) return;
    context.drawImage(picture, x, y, x2 - x, y2 - y);
  }

  #load(wanted) {
    const keys = new Set(wanted.map((tile) => tile.key));
    for (const [key, control] of this.loading) if (!keys.has(key)) control.abort();
    this.waiting = wanted.filter((tile) => !this.loading.has(tile.key));
    this.#next();
  }

  #next() {
    while (this.loading.size < AT_ONCE && this.waiting.length) this.#ask(this.waiting.shift());
  }

  async #ask(tile) {
    const control = new AbortController();
    this.loading.set(tile.key, control);
    try {
      const picture = await fetchPicture(tileAddress(this.image.ref, tile.level, tile.column, tile.row), control.signal);
      this.kept.set(tile.key, { ...tile, picture });
      this.#forget();
    } catch (error) {
      if (!control.signal.aborted) {
        this.failed.add(tile.key);
        this.onError(error.message);
      }
    }
    this.loading.delete(tile.key);
    this.onLoad();
    this.#next();
  }

  #forget() {
    for (const [key, tile] of this.kept) {
      if (this.kept.size <= MOST_KEPT) return;
      tile.picture.close();
      this.kept.delete(key);
    }
  }
}
