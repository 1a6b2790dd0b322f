// The camera: it turns around a point and looks at it. Metres, Y up; at azimuth 0 it stands on +Z.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (a, k) => [a[0] * k, a[1] * k, a[2] * k];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a, otherwise) => {
  const length = Math.hypot(a[0], a[1], a[2]);
  return length > 1e-9 ? times(a, 1 / length) : otherwise;
};
const mix = (a, b, t) => [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t];

/** Tangent of half the angle of view from the lower edge to the upper. */
const HALF_VIEW = 0.27;
/** From the front left, as the strips show motions. */
const START = { azimuth: -Math.PI / 6, elevation: 0.2 };

class Camera {
  constructor() {
    this.reset();
  }

  reset() {
    this.azimuth = START.azimuth;
    this.elevation = START.elevation;
    /** How much closer than the distance at which everything fits. */
    this.zoom = 1;
    /** How far the point looked at is moved off the figures, in metres. */
    this.pan = [0, 0, 0];
  }

  turn(right, up) {
    this.azimuth = (this.azimuth - right) % (2 * Math.PI);
    this.elevation = Math.min(Math.max(this.elevation + up, 0.01), 1.55);
  }

  closer(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.15), 12);
  }

  /** Moves the point looked at along the picture, in metres. */
  shift(right, up) {
    const axes = directions(this.azimuth, this.elevation);
    this.pan = add(this.pan, add(times(axes.right, right), times(axes.up, up)));
    this.pan = this.pan.map((x) => Math.min(Math.max(x, -50), 50));
  }
}

/** The picture's axes in the world. */
function directions(azimuth, elevation) {
  const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
  return { right: [ca, 0, -sa], up: [-se * sa, ce, -se * ca], back: [sa * ce, se, ca * ce] };
}

/** What a camera sees through one rectangle of the canvas. */
class Lens {
  constructor(camera, fit, focus, cell) {
    Object.assign(this, directions(camera.azimuth, camera.elevation));
    this.distance = fit / camera.zoom;
    this.focus = add(focus, camera.pan);
    this.focal = cell.height / 2 / HALF_VIEW;
    this.middle = [cell.x + cell.width / 2, cell.y + cell.height * 0.53];
  }

  /** A point as x and y on the canvas, depth in metres, and pixels a metre there. */
  project(point) {
    const from = sub(point, this.focus);
    const depth = this.distance - dot(from, this.back);
    const scale = this.focal / Math.max(depth, 0.05);
    return {
      x: this.middle[0] + dot(from, this.right) * scale,
      y: this.middle[1] - dot(from, this.up) * scale,
      depth,
      scale,
    };
  }

  /** A direction as the picture has it: right, up, towards the eye. */
  seen(direction) {
    return [dot(direction, this.right), dot(direction, this.up), dot(direction, this.back)];
  }
}

/** The distance from which points (seen from the point looked at) fit into a rectangle at the start's angles. */
function distanceToFit(points, cell) {
  const { right, up, back } = directions(START.azimuth, START.elevation);
  const [wide, high] = [(HALF_VIEW * 0.94 * cell.width) / cell.height, HALF_VIEW * 0.84];
  const margin = 0.12;
  let distance = 1;
  for (const point of points) {
    const needed = Math.max((Math.abs(dot(point, right)) + margin) / wide, (Math.abs(dot(point, up)) + margin) / high);
    distance = Math.max(distance, needed + dot(point, back));
  }
  return distance;
}
