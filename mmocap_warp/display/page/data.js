"use strict";
// What Python packed: little-endian values in base64, as mmocap_warp/display/page/page_content.py writes them.
const KINDS = { u2: Uint16Array, u4: Uint32Array, i2: Int16Array, f4: Float32Array };

function unpack(packed) {
  const text = atob(packed.data);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return new KINDS[packed.kind](bytes.buffer);
}

// How every joint turns and where it is, at a position between two frames too.
class Track {
  constructor(motion, joints) {
    this.joints = joints;
    this.turn = unpack(motion.turn); // (frame, joint, 4) quaternions x, y, z, w
    this.place = unpack(motion.place.values); // (frame, joint, 3)
    this.low = motion.place.low;
    this.step = motion.place.step;
  }

  // Writes a quaternion and a place, (joint, 8), into `out`.
  at(position, out) {
    const last = this.place.length / (3 * this.joints) - 1;
    const before = Math.min(Math.floor(position), last);
    const after = Math.min(before + 1, last);
    const share = position - before;
    for (let j = 0; j < this.joints; j++) {
      const a = 4 * (before * this.joints + j), b = 4 * (after * this.joints + j);
      let along = 0;
      for (let i = 0; i < 4; i++) along += this.turn[a + i] * this.turn[b + i];
      const towards = along < 0 ? -share : share; // a quaternion and its negative are one rotation
      let length = 0;
      for (let i = 0; i < 4; i++) {
        const value = (1 - share) * this.turn[a + i] + towards * this.turn[b + i];
        out[8 * j + i] = value;
        length += value * value;
      }
      length = Math.sqrt(length);
      for (let i = 0; i < 4; i++) out[8 * j + i] /= length;
      const c = 3 * (before * this.joints + j), d = 3 * (after * this.joints + j);
      for (let i = 0; i < 3; i++) {
        const steps = (1 - share) * this.place[c + i] + share * this.place[d + i];
        out[8 * j + 4 + i] = this.low[i] + this.step * steps;
      }
    }
    return out;
  }

  // The corners of the box that all joints stay in.
  extent() {
    const low = [65535, 65535, 65535], high = [0, 0, 0];
    this.place.forEach((value, i) => {
      low[i % 3] = Math.min(low[i % 3], value);
      high[i % 3] = Math.max(high[i % 3], value);
    });
    return [low, high].map((corner) => corner.map((value, i) => this.low[i] + this.step * value));
  }
}
