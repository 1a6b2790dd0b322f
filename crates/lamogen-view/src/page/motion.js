// Decoding and interpolation of the motions in the page.

/** Decodes base64 to bytes. */
function decode(text) {
  const binary = atob(text);
  return new DataView(Uint8Array.from(binary, (letter) => letter.charCodeAt(0)).buffer);
}

/** Decodes base64 to an array of little-endian 32-bit floats. */
function decodeFloats(text) {
  const bytes = decode(text);
  return Float32Array.from({ length: bytes.byteLength / 4 }, (_, i) => bytes.getFloat32(4 * i, true));
}

/** Decodes a motion of the page's data. */
function decodeMotion({ label, colour, frames, step, pelvis, others }, joints, rate) {
  const path = decodeFloats(pelvis);
  const offsets = decode(others);
  const values = new Float64Array(frames * joints * 3);
  for (let frame = 0; frame < frames; frame++) {
    for (let joint = 0; joint < joints; joint++) {
      for (let axis = 0; axis < 3; axis++) {
        const other = ((frame * (joints - 1) + joint - 1) * 3 + axis) * 2;
        const offset = joint === 0 ? 0 : offsets.getInt16(other, true) * step;
        values[(frame * joints + joint) * 3 + axis] = path[frame * 3 + axis] + offset;
      }
    }
  }
  return new Motion({ label, colour, values }, joints, rate);
}

/** A motion: the position of every joint at every frame, in metres. */
class Motion {
  /** `values` are frames × joints × 3 numbers. */
  constructor({ label, colour, values }, joints, rate) {
    Object.assign(this, { label, colour, values, joints, rate });
    this.frames = values.length / (joints * 3);
    this.path = this.smoothPath();
  }

  /** The time from the first frame to the last one, in seconds. */
  get duration() {
    return (this.frames - 1) / this.rate;
  }

  /** Returns the positions of all joints at a time. Before the start and after the end, the body stands still. */
  pose(time) {
    const { values, joints, frames } = this;
    const place = Math.min(Math.max(time * this.rate, 0), frames - 1);
    const frame = Math.min(Math.floor(place), Math.max(frames - 2, 0));
    const t = place - frame;
    const width = joints * 3;
    const at = (f) => Math.min(Math.max(f, 0), frames - 1) * width;
    const [a, b, c, d] = [at(frame - 1), at(frame), at(frame + 1), at(frame + 2)];
    // Catmull-Rom spline: it passes through every frame and has no corners in slow motion.
    const wa = t * (-0.5 + t * (1 - 0.5 * t));
    const wb = 1 + t * t * (1.5 * t - 2.5);
    const wc = t * (0.5 + t * (2 - 1.5 * t));
    const wd = t * t * (0.5 * t - 0.5);
    const between = (i) => wa * values[a + i] + wb * values[b + i] + wc * values[c + i] + wd * values[d + i];
    return Array.from({ length: joints }, (_, j) => [between(3 * j), between(3 * j + 1), between(3 * j + 2)]);
  }

  /** Returns the smoothed path of the pelvis over the ground, for a camera that follows without shaking: x and z for each frame. */
  smoothPath() {
    const reach = 14;
    const weights = Array.from({ length: 2 * reach + 1 }, (_, i) => Math.exp(-0.5 * ((i - reach) / 5) ** 2));
    const sum = weights.reduce((a, b) => a + b);
    return Array.from({ length: this.frames }, (_, frame) =>
      [0, 2].map((axis) => {
        let total = 0;
        weights.forEach((weight, i) => {
          const near = Math.min(Math.max(frame + i - reach, 0), this.frames - 1);
          total += weight * this.values[near * this.joints * 3 + axis];
        });
        return total / sum;
      }),
    );
  }

  /** Returns the smoothed path at a time: x and z. */
  along(time) {
    const place = Math.min(Math.max(time * this.rate, 0), this.frames - 1);
    const frame = Math.min(Math.floor(place), Math.max(this.frames - 2, 0));
    const from = this.path[frame];
    const to = this.path[Math.min(frame + 1, this.frames - 1)];
    return [0, 1].map((i) => from[i] + (to[i] - from[i]) * (place - frame));
  }
}
