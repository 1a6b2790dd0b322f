// A stage whose view stays where it is while motions follow one another, with the places and positions that were asked for.

/** The radius of the ring at a place on the floor, in metres. */
const RING = 0.12;

/** The size of the mark of a position, in pixels, and the time for which it is bright, in seconds. */
const REACH_MARK = 7;
const REACH_TIME = 0.3;

/** A scene with rings at places on the floor, and marks at positions that hands, feet and head reach. */
class MarkedScene extends Scene {
  places = [];
  reaches = [];
  /** The number of the chosen mark, or null. */
  selectedReach = null;

  draw(figures, time, lens, cell, appearance) {
    super.draw(figures, time, lens, cell, appearance);
    const { context } = this;
    context.save();
    context.beginPath();
    context.rect(cell.x, cell.y, cell.width, cell.height);
    context.clip();
    context.strokeStyle = context.fillStyle = appearance.mark;
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    this.reaches.forEach(({ part, time: moment, x, y, z }, i) => {
      const [at, below] = [lens.project([x, y, z]), lens.project([x, 0, z])];
      if (Math.min(at.depth, below.depth) < 0.1) return;
      context.globalAlpha = Math.abs(time - moment) < REACH_TIME ? 1 : 0.45;
      // The line to the floor shows how far away the position is.
      context.lineWidth = 1;
      context.setLineDash([2, 4]);
      context.beginPath();
      context.moveTo(below.x, below.y);
      context.lineTo(at.x, at.y);
      context.stroke();
      context.setLineDash([]);
      context.lineWidth = 2;
      context.beginPath();
      for (const [right, down] of [[0, -1], [1, 0], [0, 1], [-1, 0]]) context.lineTo(at.x + right * REACH_MARK, at.y + down * REACH_MARK);
      context.closePath();
      if (i === this.selectedReach) context.fill();
      context.stroke();
      context.fillText(`${part} ${number(moment)} s`, at.x, at.y - REACH_MARK - 5);
    });
    context.restore();
  }

  drawGround(lens, cell, appearance) {
    super.drawGround(lens, cell, appearance);
    const { context } = this;
    context.strokeStyle = context.fillStyle = appearance.mark;
    context.lineWidth = 2;
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    this.places.forEach(({ x, z }, i) => {
      const ring = Array.from({ length: 25 }, (_, k) => {
        const angle = (2 * Math.PI * k) / 24;
        return lens.project([x + RING * Math.cos(angle), 0, z + RING * Math.sin(angle)]);
      });
      if (ring.some(({ depth }) => depth < 0.1)) return;
      context.beginPath();
      for (const point of ring) context.lineTo(point.x, point.y);
      context.stroke();
      const middle = lens.project([x, 0, z]);
      context.fillText(String(i + 1), middle.x, middle.y + 4);
    });
  }
}

class SteadyStage extends Stage {
  constructor(canvas, labels, index, player) {
    super(canvas, labels, index, player);
    this.scene = new MarkedScene(this.context, index);
  }

  /** Shows the motions that have bones on a character, by its painter. */
  showOn(painter) {
    this.painter = painter;
  }

  draw() {
    const { painter, motions, player, canvas } = this;
    for (const motion of motions) motion.isDrawnElsewhere = Boolean(motion.bones && painter?.isReady);
    super.draw();
    if (!painter) return;
    painter.clear(canvas.width, canvas.height);
    const { all, fit, ratio } = this.layout;
    for (const { shown, cell } of all) {
      const lens = new Lens(this.camera, fit, this.focus(shown, player.time), cell);
      for (const motion of shown) {
        if (motion.isDrawnElsewhere) painter.draw(motion.bones, Math.min(player.time, motion.duration), lens, cell, ratio, motion.isGrey ? 0.85 : 0);
      }
    }
  }

  /** Returns the projection of the view under a point of the canvas, or null before the first arrangement. */
  lensAt([x, y]) {
    if (!this.layout) return null;
    const view = this.layout.all.find(({ cell }) => x >= cell.x && x < cell.x + cell.width && y >= cell.y && y < cell.y + cell.height);
    return view ? new Lens(this.camera, this.layout.fit, this.focus(view.shown, this.player.time), view.cell) : null;
  }

  arrange(dark) {
    const isNew = super.arrange(dark);
    if (isNew) this.layout.appearance.mark = getComputedStyle(document.documentElement).getPropertyValue("--accent").trim();
    return isNew;
  }

  show(motions) {
    this.kept = this.layout && motions.length === this.motions.length ? this.layout.fit : null;
    super.show(motions);
  }

  /** Returns the distance of the camera: the one that it has, if motions of about this size are seen well from there. */
  fit(all) {
    const { kept } = this;
    const fit = super.fit(all);
    return kept && fit < kept * 1.02 && fit > kept * 0.7 ? kept : fit;
  }
}
