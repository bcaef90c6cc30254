/** Two views that show the same place at the same size, as far as both images show it. */

import { inside, inverse, magnification, transform } from "./geometry.js";

export class Linked {
  constructor(far, near) {
    this.far = far;
    this.near = near;
    this.on = true;
    this.farFromNear = null;
    far.addEventListener("view", () => this.#follow(far, near, this.nearFromFar));
    near.addEventListener("view", () => this.#follow(near, far, this.farFromNear));
  }

  setModel(farFromNear) {
    this.farFromNear = farFromNear;
    this.nearFromFar = farFromNear && inverse(farFromNear);
  }

  /** Where a point of one view is in the other; null where it is not known. */
  other(view, point) {
    const m = view === this.far ? this.nearFromFar : this.farFromNear;
    const mapped = m && transform(m, point);
    return mapped && mapped.every(Number.isFinite) ? mapped : null;
  }

  #follow(moved, follower, homography) {
    if (!this.on || !homography || !follower.picture) return;
    const place = transform(homography, moved.centre);
    if (!place.every(Number.isFinite) || !inside(place, follower.size)) {
      if (follower === this.near) follower.fit();
      return;
    }
    const scale = moved.scale / magnification(homography, moved.centre);
    if (scale <= follower.fitScale) follower.fit();
    else follower.lookAt(place, scale);
  }
}
