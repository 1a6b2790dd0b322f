// Motions side by side or in one view, and the camera.

/** Returns the number of columns with the largest views. */
function bestColumns(count, width, height) {
  let columns = 1;
  const size = (n) => Math.min(width / n / 0.8, height / Math.ceil(count / n));
  for (let n = 2; n <= count; n++) if (size(n) > size(columns)) columns = n;
  return columns;
}

class Stage {
  /** `labels` is the list of the motions' labels; `index` gives the index of each joint by its name. */
  constructor(canvas, labels, index, player) {
    Object.assign(this, { canvas, labels, player });
    this.context = canvas.getContext("2d");
    this.scene = new Scene(this.context, index);
    this.camera = new Camera();
    this.motions = [];
    this.lens = null;
    /** Values that depend on sizes, colours and the selected views. */
    this.layout = null;
  }

  show(motions) {
    this.motions = motions;
    const bounds = { low: [Infinity, 0, Infinity], high: [-Infinity, 1.7, -Infinity] };
    for (const { values } of motions) {
      values.forEach((value, i) => {
        bounds.low[i % 3] = Math.min(bounds.low[i % 3], value);
        bounds.high[i % 3] = Math.max(bounds.high[i % 3], value);
      });
    }
    /** The bounding box of all motions. */
    this.bounds = bounds;
    this.middle = motions.length === 0 ? [0, 0.9, 0] : mix(bounds.low, bounds.high, 0.5);
    this.layout = null;
  }

  /** Whether a motion goes so far that it would be small in a view that stands still. */
  get travels() {
    const { low, high } = this.bounds;
    return this.motions.length > 0 && Math.max(high[0] - low[0], high[2] - low[2]) > 3;
  }

  /** The size of a pixel in metres. */
  get pixel() {
    return this.lens ? this.lens.distance / this.lens.focal : 0.01;
  }

  /** Returns the point that the camera looks at. */
  focus(shown, time) {
    if (!this.player.follow || shown.length === 0) return this.middle;
    const places = shown.map((motion) => motion.along(time));
    const mean = (i) => places.reduce((sum, place) => sum + place[i], 0) / places.length;
    return [mean(0), this.middle[1], mean(1)];
  }

  /** Whether all motions are in one view. */
  get isOneView() {
    return this.player.overlay || this.motions.length < 2;
  }

  /** Returns the motions of each view and its rectangle on the canvas. */
  views() {
    const { motions } = this;
    const { width, height } = this.canvas.getBoundingClientRect();
    if (this.isOneView) return [{ shown: motions, cell: { x: 0, y: 0, width, height } }];
    const columns = bestColumns(motions.length, width, height);
    const rows = Math.ceil(motions.length / columns);
    return motions.map((motion, i) => {
      const inRow = Math.floor(i / columns) === rows - 1 ? motions.length - columns * (rows - 1) : columns;
      const cell = { width: width / inRow, height: height / rows };
      return { shown: [motion], cell: { ...cell, x: (i % columns) * cell.width, y: Math.floor(i / columns) * cell.height } };
    });
  }

  /** Returns the distance of the camera from which every view shows all of its motions. */
  fit(all) {
    const { frames, rate } = this.player;
    const distances = all.map(({ shown, cell }) => {
      const points = [];
      for (let frame = 0; frame < frames; frame += 3) {
        const from = this.focus(shown, frame / rate);
        for (const motion of shown) for (const point of motion.pose(frame / rate)) points.push(sub(point, from));
      }
      return distanceToFit(points, cell);
    });
    return Math.max(1.5, ...distances);
  }

  /** Arranges views and labels if something has changed since the last time. Returns whether it has. */
  arrange(dark) {
    const { canvas, motions, player, labels } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 3);
    const choice = `${player.overlay} ${player.follow} ${ratio}`;
    if (this.layout && this.layout.choice === choice) return false;
    const { width, height } = canvas.getBoundingClientRect();
    const size = [width, height].map((pixels) => Math.max(Math.round(pixels * ratio), 1));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const style = getComputedStyle(document.documentElement);
    const variable = (name) => style.getPropertyValue(name).trim();
    const all = this.views();
    this.layout = {
      all,
      ratio,
      choice,
      fit: this.fit(all),
      colours: motions.map((motion) => readable(motion.colour, dark)),
      appearance: { grid: variable("--grid"), line: variable("--line"), shadow: Number(variable("--shadow")) },
    };
    motions.forEach((motion, i) => {
      const { cell } = this.isOneView ? { cell: { ...all[0].cell, y: 30 * i } } : all[i];
      const label = labels.children[i];
      label.hidden = motion.label === "";
      label.style.setProperty("--colour", css(this.layout.colours[i]));
      label.style.transform = `translate(${cell.x}px, ${cell.y}px)`;
      label.style.maxWidth = `${Math.max(cell.width - 20, 40)}px`;
    });
    return true;
  }

  /** Draws all views at the player's time. */
  draw() {
    const { context, player, motions } = this;
    const { all, ratio, appearance, colours, fit } = this.layout;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.canvas.width / ratio, this.canvas.height / ratio);
    for (const { shown, cell } of all) {
      this.lens = new Lens(this.camera, fit, this.focus(shown, player.time), cell);
      const figures = shown.map((motion) => ({ motion, colour: colours[motions.indexOf(motion)] }));
      this.scene.draw(figures, player.time, this.lens, cell, { ...appearance, trails: player.trails });
      context.strokeStyle = appearance.line;
      context.lineWidth = 1;
      context.beginPath();
      if (cell.x > 0) context.rect(cell.x - 0.5, cell.y, 0, cell.height);
      if (cell.y > 0) context.rect(cell.x, cell.y - 0.5, cell.width, 0);
      context.stroke();
    }
    byId("scale").textContent = `squares of ${gridSide(this.lens)} m`;
    motions.forEach((motion, i) => this.labels.children[i].classList.toggle("over", player.time > motion.duration + 1e-6));
  }
}
