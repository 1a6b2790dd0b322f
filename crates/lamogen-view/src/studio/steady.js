// A stage whose view stays where it is while motions follow one another, with the places that were asked for on its ground.

/** The radius of the ring at a place on the floor, in metres. */
const RING = 0.12;

/** A scene with rings at places on the floor. */
class MarkedScene extends Scene {
  places = [];

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
