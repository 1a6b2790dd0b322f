// What stands in one view: ground, shadows, trails, figures; far things first.

/** Towards the light. */
const LIGHT = unit([-0.5, 1, 0.12]);
/** Seconds that a trail lasts. */
const TRAIL = 1.2;

/** The outline of circles {x, y, r} and all between them, as a convex polygon. */
function hull(circles) {
  const points = [];
  for (const { x, y, r } of circles) {
    const corners = Math.min(Math.max(Math.ceil(r * 1.5), 14), 64);
    for (let i = 0; i < corners; i++) {
      const angle = (2 * Math.PI * i) / corners;
      points.push([x + r * Math.cos(angle), y + r * Math.sin(angle)]);
    }
  }
  return convex(points);
}

/** The convex hull of points, by Andrew's monotone chain. */
function convex(points) {
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

function trace(context, polygon) {
  context.beginPath();
  polygon.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.closePath();
}

class Scene {
  /** Draws on a canvas's context; sizes are in CSS pixels. */
  constructor(context, index) {
    this.context = context;
    this.index = index;
    this.shade = document.createElement("canvas");
    this.blur = document.createElement("canvas");
  }

  /**
   * One view: figures are [{ motion, colour }] at a time, seen through a lens in a cell.
   * `look` is { grid, shadow, trails, ratio }.
   */
  draw(figures, time, lens, cell, look) {
    const { context } = this;
    context.save();
    context.beginPath();
    context.rect(cell.x, cell.y, cell.width, cell.height);
    context.clip();
    this.ground(lens, cell, look);
    const bodies = figures.map(({ motion, colour }) => {
      const parts = bodyParts(motion.pose(time), this.index);
      const skin = mix(colour, WHITE, 0.6);
      const tones = { middle: colour, right: colour, left: mix(colour, WHITE, 0.25), end: skin, nose: times(skin, 0.9) };
      return { motion, parts, tones };
    });
    this.shadows(bodies, lens, cell, look);
    const things = [];
    for (const { motion, parts, tones } of bodies) {
      for (const part of parts) this.solid(things, part, tones[part.tone], lens);
      if (look.trails) this.trails(things, motion, time, tones.right, lens);
    }
    things.sort((a, b) => b.depth - a.depth);
    for (const thing of things) thing.paint();
    context.restore();
  }

  /** Squares of half a metre (more from afar) that fade out around the point looked at. */
  ground(lens, cell, look) {
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
      context.strokeStyle = `rgba(${look.grid}, ${(0.34 * (shade + 0.5)) / shades})`;
      context.beginPath();
      for (const [a, b] of bucket) {
        context.moveTo(a.x, a.y);
        context.lineTo(b.x, b.y);
      }
      context.stroke();
    });
  }

  /** Shadows are drawn small and stretched, which blurs them in every browser. */
  shadows(bodies, lens, cell, look) {
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
      // Of a high jump the shadow is faint.
      ink.globalAlpha = Math.min(Math.max(1 - 0.6 * lowest, 0.3), 1);
      for (const balls of parts.flatMap(({ hulls }) => hulls)) {
        const points = [];
        for (const [centre, radius] of balls) {
          const fall = Math.max(centre[1], 0) / LIGHT[1];
          for (let i = 0; i < 14; i++) {
            const angle = (2 * Math.PI * i) / 14;
            const spot = [centre[0] - LIGHT[0] * fall + radius * Math.cos(angle), 0, centre[2] - LIGHT[2] * fall + radius * Math.sin(angle)];
            const seen = lens.project(spot);
            if (seen.depth > 0.1) points.push([(seen.x - cell.x) / small, (seen.y - cell.y) / small]);
          }
        }
        if (points.length < 3) continue;
        trace(ink, convex(points));
        ink.fill();
      }
    }
    const soft = blur.getContext("2d");
    soft.imageSmoothingEnabled = ink.imageSmoothingEnabled = context.imageSmoothingEnabled = true;
    soft.imageSmoothingQuality = context.imageSmoothingQuality = "high";
    soft.drawImage(shade, 0, 0, blur.width, blur.height);
    context.save();
    context.globalAlpha = look.shadow * 0.3;
    context.drawImage(shade, cell.x, cell.y, shade.width * small, shade.height * small);
    context.globalAlpha = look.shadow * 0.7;
    context.drawImage(blur, cell.x, cell.y, blur.width * small * smaller, blur.height * small * smaller);
    context.restore();
  }

  /** A body part, shaded across its length as a round thing is. */
  solid(things, { tone, hulls, axis: [from, to] }, colour, lens) {
    const outlines = hulls.map((balls) =>
      balls.map(([centre, radius]) => {
        const seen = lens.project(centre);
        return { x: seen.x, y: seen.y, r: radius * seen.scale, depth: seen.depth };
      }),
    );
    const circles = outlines.flat();
    if (circles.some((circle) => circle.depth < 0.15)) return;
    const depth = circles.reduce((sum, circle) => sum + circle.depth, 0) / circles.length;
    const { context } = this;
    // The long axis, the direction across it in the picture, and the one of its surface that faces the eye.
    const axis = unit(lens.seen(sub(to, from)), [0, 1, 0]);
    const across = unit([-axis[1], axis[0], 0], [1, 0, 0]);
    const facing = cross(across, axis);
    // Of what points at the eye one sees the round end.
    const front = unit(mix(times(facing, Math.sign(facing[2]) || 1), [0, 0, 1], axis[2] ** 2), [0, 0, 1]);
    // Some of the light goes along with the eye, so that no side is ever black.
    const light = unit(add(times(lens.seen(LIGHT), 0.6), [-0.3, 0.2, 0.7]));
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
        gradient.addColorStop(stop / 8, css(lit(colour, 0.62 + 0.46 * bright + 0.12 * bright ** 14)));
      }
      // The edge first, so that it shows around the part and not inside it.
      const polygons = outlines.map(hull);
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

  /** Where hands and feet were a moment ago. */
  trails(things, motion, time, colour, lens) {
    const end = Math.min(time, motion.duration);
    const start = Math.max(end - TRAIL, 0);
    const steps = Math.ceil((end - start) * motion.rate * 2);
    if (steps < 1) return;
    const { context } = this;
    const moments = Array.from({ length: steps + 1 }, (_, i) => start + ((end - start) * i) / steps);
    const poses = moments.map((moment) => motion.pose(moment));
    for (const name of TRAILING) {
      const seen = poses.map((pose) => lens.project(pose[this.index[name]]));
      for (let i = 0; i < steps; i++) {
        const [a, b] = [seen[i], seen[i + 1]];
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
        // Behind the hand or foot that draws it.
        things.push({ depth: (a.depth + b.depth) / 2 + 0.03, paint });
      }
    }
  }
}

/** Metres between the ground's lines. */
function gridSide(lens) {
  return lens.distance < 11 ? 0.5 : 2 ** Math.ceil(Math.log2(lens.distance / 11));
}
