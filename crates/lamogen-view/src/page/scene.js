// Drawing of one view: ground, shadows, trails and figures, the farthest ones first.

/** The direction towards the light. */
const LIGHT = unit([-0.5, 1, 0.12]);
/** The duration of a trail in seconds. */
const TRAIL = 1.2;

/** Returns the convex hull of circles {x, y, r} as a polygon. */
function circleHull(circles) {
  const points = [];
  for (const { x, y, r } of circles) {
    const corners = Math.min(Math.max(Math.ceil(r * 1.5), 14), 64);
    for (let i = 0; i < corners; i++) {
      const angle = (2 * Math.PI * i) / corners;
      points.push([x + r * Math.cos(angle), y + r * Math.sin(angle)]);
    }
  }
  return convexHull(points);
}

/** Returns the convex hull of points, by Andrew's monotone chain. */
function convexHull(points) {
  points.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (ordered) => {
    const chain = [];
    for (const point of ordered) {
      while (chain.length > 1) {
        const [a, b] = [chain[chain.length - 2], chain[chain.length - 1]];
        if ((b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]) > 0) break;
        chain.pop();
      }
      chain.push(point);
    }
    chain.pop();
    return chain;
  };
  return half(points).concat(half(points.reverse()));
}

/** Makes a polygon the current path. */
function trace(context, polygon) {
  context.beginPath();
  polygon.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.closePath();
}

class Scene {
  /** Draws on the context of a canvas. Sizes are in CSS pixels. `index` gives the index of each joint by its name. */
  constructor(context, index) {
    this.context = context;
    this.index = index;
    this.shade = document.createElement("canvas");
    this.blur = document.createElement("canvas");
  }

  /**
   * Draws one view: figures [{ motion, colour }] at a time, projected by a lens into a cell of the canvas. Of a motion that is drawn elsewhere
   * there is the shadow alone.
   * `appearance` is { grid, shadow, trails }.
   */
  draw(figures, time, lens, cell, appearance) {
    const { context } = this;
    context.save();
    context.beginPath();
    context.rect(cell.x, cell.y, cell.width, cell.height);
    context.clip();
    this.drawGround(lens, cell, appearance);
    const bodies = figures.map(({ motion, colour }) => {
      const parts = bodyParts(motion.pose(time), this.index);
      const skin = mix(colour, WHITE, 0.6);
      const tones = { middle: colour, right: colour, left: mix(colour, WHITE, 0.25), end: skin, nose: times(skin, 0.9) };
      return { motion, parts, tones };
    });
    this.drawShadows(bodies, lens, cell, appearance);
    const things = [];
    for (const { motion, parts, tones } of bodies) {
      if (!motion.isDrawnElsewhere) for (const part of parts) this.addPart(things, part, tones[part.tone], lens);
      if (appearance.trails) this.addTrails(things, motion, time, tones.right, lens);
    }
    things.sort((a, b) => b.depth - a.depth);
    for (const thing of things) thing.paint();
    context.restore();
  }

  /** Draws squares of half a metre (larger ones from far away) that fade out around the point that the camera looks at. */
  drawGround(lens, cell, appearance) {
    const { context } = this;
    const reach = Math.max(3.2, lens.distance * 0.75);
    const side = gridSide(lens);
    const lines = Math.ceil(reach / side);
    const [middleX, middleZ] = [lens.focus[0], lens.focus[2]];
    const [startX, startZ] = [middleX, middleZ].map((x) => Math.round(x / side));
    const shades = 10;
    const buckets = Array.from({ length: shades }, () => []);
    const segment = (from, to, alongX) => {
      const away = Math.hypot((from[0] + to[0]) / 2 - middleX, (from[2] + to[2]) / 2 - middleZ) / reach;
      if (away >= 1) return;
      const [a, b] = [lens.project(from), lens.project(to)];
      if (a.depth < 0.1 || b.depth < 0.1) return;
      buckets[Math.floor((1 - away * away) ** 1.5 * (shades - 0.01))].push([a, b, alongX]);
    };
    for (let i = -lines; i <= lines; i++) {
      for (let k = -lines; k < lines; k++) {
        const [x, z] = [(startX + i) * side, (startZ + k) * side];
        segment([x, 0, z], [x, 0, z + side]);
        const [x2, z2] = [(startX + k) * side, (startZ + i) * side];
        segment([x2, 0, z2], [x2 + side, 0, z2]);
      }
    }
    context.lineWidth = 1;
    buckets.forEach((bucket, shade) => {
      context.strokeStyle = `rgba(${appearance.grid}, ${(0.34 * (shade + 0.5)) / shades})`;
      context.beginPath();
      for (const [a, b] of bucket) {
        context.moveTo(a.x, a.y);
        context.lineTo(b.x, b.y);
      }
      context.stroke();
    });
  }

  /** Draws shadows at a small size and enlarges them, which blurs them in every browser. */
  drawShadows(bodies, lens, cell, appearance) {
    const { context, shade, blur } = this;
    const small = 3;
    const smaller = 4;
    shade.width = Math.max(Math.ceil(cell.width / small), 1);
    shade.height = Math.max(Math.ceil(cell.height / small), 1);
    blur.width = Math.max(Math.ceil(shade.width / smaller), 1);
    blur.height = Math.max(Math.ceil(shade.height / smaller), 1);
    const ink = shade.getContext("2d");
    ink.fillStyle = "#000";
    for (const { parts } of bodies) {
      const lowest = Math.min(...parts.flatMap(({ hulls }) => hulls.flat()).map(([centre, radius]) => centre[1] - radius));
      // The shadow of a high jump is faint.
      ink.globalAlpha = Math.min(Math.max(1 - 0.6 * lowest, 0.3), 1);
      for (const balls of parts.flatMap(({ hulls }) => hulls)) {
        const points = [];
        for (const [centre, radius] of balls) {
          const fall = Math.max(centre[1], 0) / LIGHT[1];
          for (let i = 0; i < 14; i++) {
            const angle = (2 * Math.PI * i) / 14;
            const spot = [centre[0] - LIGHT[0] * fall + radius * Math.cos(angle), 0, centre[2] - LIGHT[2] * fall + radius * Math.sin(angle)];
            const projected = lens.project(spot);
            if (projected.depth > 0.1) points.push([(projected.x - cell.x) / small, (projected.y - cell.y) / small]);
          }
        }
        if (points.length < 3) continue;
        trace(ink, convexHull(points));
        ink.fill();
      }
    }
    const soft = blur.getContext("2d");
    soft.imageSmoothingEnabled = ink.imageSmoothingEnabled = context.imageSmoothingEnabled = true;
    soft.imageSmoothingQuality = context.imageSmoothingQuality = "high";
    soft.drawImage(shade, 0, 0, blur.width, blur.height);
    context.save();
    context.globalAlpha = appearance.shadow * 0.3;
    context.drawImage(shade, cell.x, cell.y, shade.width * small, shade.height * small);
    context.globalAlpha = appearance.shadow * 0.7;
    context.drawImage(blur, cell.x, cell.y, blur.width * small * smaller, blur.height * small * smaller);
    context.restore();
  }

  /** Adds a body part that is shaded like a cylinder along its axis. */
  addPart(things, { tone, hulls, axis: [from, to] }, colour, lens) {
    const outlines = hulls.map((balls) =>
      balls.map(([centre, radius]) => {
        const projected = lens.project(centre);
        return { x: projected.x, y: projected.y, r: radius * projected.scale, depth: projected.depth };
      }),
    );
    const circles = outlines.flat();
    if (circles.some((circle) => circle.depth < 0.15)) return;
    const depth = circles.reduce((sum, circle) => sum + circle.depth, 0) / circles.length;
    const { context } = this;
    // The long axis, the direction across it in the picture, and the normal of the surface that faces the camera.
    const axis = unit(lens.toView(sub(to, from)), [0, 1, 0]);
    const across = unit([-axis[1], axis[0], 0], [1, 0, 0]);
    const facing = cross(across, axis);
    // If the axis points at the camera, the round end is visible.
    const front = unit(mix(times(facing, Math.sign(facing[2]) || 1), [0, 0, 1], axis[2] ** 2), [0, 0, 1]);
    // A part of the light moves with the camera, so that no side is ever black.
    const light = unit(add(times(lens.toView(LIGHT), 0.6), [-0.3, 0.2, 0.7]));
    const paint = () => {
      const reach = (sign) => Math.max(...circles.map((c) => sign * (c.x * across[0] - c.y * across[1]) + c.r));
      const [low, high] = [-reach(-1), reach(1)];
      const [middle, half] = [(low + high) / 2, (high - low) / 2];
      const centre = circles.reduce((sum, c) => sum + (c.x * axis[0] - c.y * axis[1]), 0) / circles.length;
      const length = Math.hypot(axis[0], axis[1]) || 1;
      const place = (s) => {
        const [u, v] = [middle + s * half, centre / length];
        const along = [axis[0] / length, axis[1] / length];
        return [u * across[0] + v * along[0], -(u * across[1] + v * along[1])];
      };
      const gradient = context.createLinearGradient(...place(-1), ...place(1));
      for (let stop = 0; stop <= 8; stop++) {
        const s = (stop / 8) * 2 - 1;
        const normal = add(times(across, s), times(front, Math.sqrt(Math.max(1 - s * s, 0))));
        const bright = Math.max(dot(normal, light), 0);
        gradient.addColorStop(stop / 8, css(shaded(colour, 0.62 + 0.46 * bright + 0.12 * bright ** 14)));
      }
      // Draw the edge first, so that it is visible around the part and not inside it.
      const polygons = outlines.map(circleHull);
      context.strokeStyle = css(times(colour, 0.42), 0.6);
      context.lineWidth = 2 * Math.min(Math.max(0.004 * (lens.focal / depth), 0.5), 2);
      context.fillStyle = gradient;
      for (const polygon of tone === "nose" ? [] : polygons) {
        trace(context, polygon);
        context.stroke();
      }
      for (const polygon of polygons) {
        trace(context, polygon);
        context.fill();
      }
    };
    things.push({ depth, paint });
  }

  /** Adds the recent paths of hands and feet. */
  addTrails(things, motion, time, colour, lens) {
    const end = Math.min(time, motion.duration);
    const start = Math.max(end - TRAIL, 0);
    const steps = Math.ceil((end - start) * motion.rate * 2);
    if (steps < 1) return;
    const { context } = this;
    const moments = Array.from({ length: steps + 1 }, (_, i) => start + ((end - start) * i) / steps);
    const poses = moments.map((moment) => motion.pose(moment));
    for (const name of TRAIL_JOINTS) {
      const projected = poses.map((pose) => lens.project(pose[this.index[name]]));
      for (let i = 0; i < steps; i++) {
        const [a, b] = [projected[i], projected[i + 1]];
        if (a.depth < 0.15 || b.depth < 0.15) continue;
        const fresh = 1 - (end - moments[i + 1]) / TRAIL;
        const paint = () => {
          context.strokeStyle = css(colour, 0.75 * fresh);
          context.lineWidth = Math.max(0.018 * fresh * b.scale, 0.6);
          context.lineCap = "butt";
          context.beginPath();
          context.moveTo(a.x, a.y);
          context.lineTo(b.x, b.y);
          context.stroke();
        };
        // Draw the trail behind its hand or foot.
        things.push({ depth: (a.depth + b.depth) / 2 + 0.03, paint });
      }
    }
  }
}

/** Returns the distance between the lines on the ground in metres. */
function gridSide(lens) {
  return lens.distance < 11 ? 0.5 : 2 ** Math.ceil(Math.log2(lens.distance / 11));
}
