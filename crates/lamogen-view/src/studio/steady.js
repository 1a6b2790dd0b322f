// A stage whose view stays where it is while motions follow one another.

class SteadyStage extends Stage {
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
