// The camera, which turns around the point that it looks at. Lengths are in metres, Y is up; at azimuth 0 the camera is on +Z.

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

/** The tangent of half the vertical angle of view. */
const HALF_VIEW = 0.27;
/** The first view is from the front left, as in strips. */
const START = { azimuth: -Math.PI / 6, elevation: 0.2 };

class Camera {
  constructor() {
    this.reset();
  }

  reset() {
    this.azimuth = START.azimuth;
    this.elevation = START.elevation;
    /** The zoom relative to the distance at which everything fits. */
    this.zoom = 1;
    /** The offset from the figures to the point that the camera looks at, in metres. */
    this.pan = [0, 0, 0];
  }

  turn(right, up) {
    this.azimuth = (this.azimuth - right) % (2 * Math.PI);
    this.elevation = Math.min(Math.max(this.elevation + up, 0.01), 1.55);
  }

  closer(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.15), 12);
  }

  /** Moves the point that the camera looks at along the axes of the picture, in metres. */
  shift(right, up) {
    const axes = directions(this.azimuth, this.elevation);
    this.pan = add(this.pan, add(times(axes.right, right), times(axes.up, up)));
    this.pan = this.pan.map((x) => Math.min(Math.max(x, -50), 50));
  }
}

/** Returns the axes of the picture in the world. */
function directions(azimuth, elevation) {
  const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
  return { right: [ca, 0, -sa], up: [-se * sa, ce, -se * ca], back: [sa * ce, se, ca * ce] };
}

/** The projection of a camera into one rectangle of the canvas. */
class Lens {
  constructor(camera, fit, focus, cell) {
    Object.assign(this, directions(camera.azimuth, camera.elevation));
    this.distance = fit / camera.zoom;
    this.focus = add(focus, camera.pan);
    this.focal = cell.height / 2 / HALF_VIEW;
    this.middle = [cell.x + cell.width / 2, cell.y + cell.height * 0.53];
  }

  /** Projects a point: x and y on the canvas, depth in metres, and the scale there in pixels per metre. */
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

  /** Converts a direction to the axes of the picture: right, up, towards the camera. */
  toView(direction) {
    return [dot(direction, this.right), dot(direction, this.up), dot(direction, this.back)];
  }
}

/** Returns the distance from which points fit into a rectangle at the angles of the first view. The points are relative to the one that the camera looks at. */
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
