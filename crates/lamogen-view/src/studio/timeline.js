// The keys of a component's factor over time: points that can be set, dragged, moved by keys and removed.

/** Keys stand on frames. */
const KEY_STEP = 0.05;
/** The space around the lane, in pixels; left and right as of the charts. */
const LANE_EDGE = { left: 40, right: 14, top: 12, bottom: 20 };

class Timeline {
  /** `time()` is the moment that is shown, counted from the beginning of the sentence. `moved(isReleased)` is called after the sentence has been changed. */
  constructor(elements, components, moved) {
    Object.assign(this, { ...elements, components, moved });
    this.component = 0;
    this.selected = null;
    this.tabs = components.map(({ name }, c) => {
      const tab = append(this.lanes, "button", "", name);
      tab.type = "button";
      tab.addEventListener("click", () => {
        this.component = c;
        this.selected = null;
        this.show(this.sentence);
      });
      return tab;
    });
    this.lane.addEventListener("pointerdown", (event) => this.press(event));
    this.lane.addEventListener("pointermove", (event) => {
      if (this.held !== undefined) this.drag(event);
    });
    const release = () => {
      if (this.held === undefined) return;
      this.held = undefined;
      this.moved(true);
    };
    this.lane.addEventListener("pointerup", release);
    this.lane.addEventListener("pointercancel", release);
    this.lane.addEventListener("keydown", (event) => this.pressKey(event));
    this.slides.addEventListener("change", () => {
      this.sentence.slides[this.component] = this.slides.checked;
      this.change(true);
    });
    this.add.addEventListener("click", () => this.insert(this.time(), this.factorAt(this.time())));
    this.remove.addEventListener("click", () => this.removeSelected());
    this.clear.addEventListener("click", () => {
      this.sentence.keys[this.component] = [];
      this.selected = null;
      this.change(true);
    });
  }

  get keys() {
    return this.sentence.keys[this.component];
  }

  /** The last time at which a key may be. */
  get last() {
    return Math.max(Math.floor(this.sentence.seconds / KEY_STEP - 0.5) * KEY_STEP, 0);
  }

  change(isReleased) {
    this.show(this.sentence);
    this.moved(isReleased);
  }

  /** Returns the factor of the component at a time. */
  factorAt(time) {
    const { keys } = this;
    if (keys.length === 0) return this.sentence.factors[this.component];
    const after = keys.findIndex((key) => key.time > time);
    if (after === 0) return 1;
    const from = keys[after < 0 ? keys.length - 1 : after - 1];
    if (after < 0 || !this.sentence.slides[this.component]) return from.factor;
    const to = keys[after];
    return from.factor + ((to.factor - from.factor) * (time - from.time)) / (to.time - from.time);
  }

  insert(time, factor) {
    const place = this.snap(time, factor);
    const { keys } = this;
    // Before its first key a factor is 1; the slider's stays at the beginning.
    if (keys.length === 0 && place.time > 0) keys.push({ time: 0, factor: this.sentence.factors[this.component] });
    const there = keys.find((key) => Math.abs(key.time - place.time) < KEY_STEP / 2);
    if (there) Object.assign(there, place);
    else keys.push(place);
    keys.sort((a, b) => a.time - b.time);
    this.selected = keys.findIndex((key) => Math.abs(key.time - place.time) < KEY_STEP / 2);
    this.change(true);
  }

  snap(time, factor) {
    const frames = Math.round(Math.min(Math.max(time, 0), this.last) / KEY_STEP);
    const steps = Math.round(Math.min(Math.max(factor, LOWEST), HIGHEST) / 0.05);
    return { time: number(frames * KEY_STEP), factor: number(steps * 0.05) };
  }

  removeSelected() {
    if (this.selected === null) return;
    this.keys.splice(this.selected, 1);
    this.selected = null;
    this.change(true);
  }

  /** Moves the selected key, but not past its neighbours. */
  move(time, factor, isReleased) {
    const { keys, selected } = this;
    const low = selected > 0 ? keys[selected - 1].time + KEY_STEP : 0;
    const high = selected < keys.length - 1 ? keys[selected + 1].time - KEY_STEP : this.last;
    keys[selected] = this.snap(Math.min(Math.max(time, low), high), factor);
    this.change(isReleased);
  }

  point(event) {
    const box = this.lane.getBoundingClientRect();
    const across = (event.clientX - box.left - LANE_EDGE.left) / (box.width - LANE_EDGE.left - LANE_EDGE.right);
    const up = 1 - (event.clientY - box.top - LANE_EDGE.top) / (box.height - LANE_EDGE.top - LANE_EDGE.bottom);
    return { time: across * this.sentence.seconds, factor: LOWEST + up * (HIGHEST - LOWEST) };
  }

  press(event) {
    if (event.button !== 0) return;
    event.preventDefault();
    this.lane.setPointerCapture(event.pointerId);
    const key = event.target.closest("[data-key]");
    if (key) {
      this.selected = Number(key.dataset.key);
      this.show(this.sentence);
    } else {
      const { time, factor } = this.point(event);
      this.insert(time, factor);
    }
    this.held = event.pointerId;
    this.lane.querySelector(`[data-key="${this.selected}"]`)?.focus();
  }

  drag(event) {
    if (event.pointerId !== this.held || this.selected === null) return;
    const { time, factor } = this.point(event);
    this.move(time, factor, false);
  }

  pressKey(event) {
    const key = event.target.closest("[data-key]");
    if (!key) return;
    this.selected = Number(key.dataset.key);
    const { time, factor } = this.keys[this.selected];
    const actions = {
      ArrowLeft: () => this.move(time - KEY_STEP, factor, true),
      ArrowRight: () => this.move(time + KEY_STEP, factor, true),
      ArrowUp: () => this.move(time, factor + 0.05, true),
      ArrowDown: () => this.move(time, factor - 0.05, true),
      Delete: () => this.removeSelected(),
      Backspace: () => this.removeSelected(),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
    this.lane.querySelector(`[data-key="${this.selected}"]`)?.focus();
  }

  show(sentence) {
    this.sentence = sentence;
    const { lane, keys, component } = this;
    if (this.selected !== null && this.selected >= keys.length) this.selected = null;
    this.tabs.forEach((tab, c) => {
      tab.setAttribute("aria-pressed", String(c === component));
      tab.classList.toggle("has-keys", sentence.keys[c].length > 0);
    });
    this.slides.checked = sentence.slides[component];
    this.remove.disabled = this.selected === null;
    this.clear.disabled = keys.length === 0;
    const focused = lane.contains(document.activeElement) ? document.activeElement.dataset.key : null;
    const { width, height } = lane.getBoundingClientRect();
    if (width === 0) return;
    const x = (time) => LANE_EDGE.left + (time / sentence.seconds) * (width - LANE_EDGE.left - LANE_EDGE.right);
    const y = (factor) => height - LANE_EDGE.bottom - ((factor - LOWEST) / (HIGHEST - LOWEST)) * (height - LANE_EDGE.top - LANE_EDGE.bottom);
    lane.setAttribute("viewBox", `0 0 ${width} ${height}`);
    lane.replaceChildren();
    for (const factor of [0.5, 1, 1.5, 2]) {
      draw(lane, "path", { d: `M${LANE_EDGE.left} ${y(factor)}H${width - LANE_EDGE.right}`, class: factor === 1 ? "rule one" : "rule" });
      draw(lane, "text", { x: LANE_EDGE.left - 6, y: y(factor) + 4, "text-anchor": "end" }).textContent = `×${factor}`;
    }
    const step = roundStep(sentence.seconds, Math.max(width / 80, 2));
    for (let i = 0; i * step <= sentence.seconds + 1e-6; i++) {
      const at = x(i * step);
      draw(lane, "text", { x: at, y: height - 5, "text-anchor": at > width - 20 ? "end" : "middle" }).textContent = `${Number((i * step).toPrecision(3))} s`;
    }
    const samples = Math.max(Math.round(sentence.seconds / KEY_STEP), 1);
    let path = "";
    for (let i = 0; i <= samples; i++) {
      const time = Math.min(i * KEY_STEP, sentence.seconds);
      const [at, factor] = [x(time).toFixed(1), y(this.factorAt(time)).toFixed(1)];
      path += i === 0 ? `M${at} ${factor}` : sentence.slides[component] || keys.length === 0 ? `L${at} ${factor}` : `H${at}V${factor}`;
    }
    draw(lane, "path", { d: path, class: "line factor" });
    keys.forEach(({ time, factor }, i) => {
      const name = `${this.components[component].name} ${asFactor(factor)} at ${number(time)} seconds`;
      const group = draw(lane, "g", { "data-key": i, tabindex: 0, role: "slider", "aria-label": name, "aria-valuenow": factor, "aria-valuemin": LOWEST, "aria-valuemax": HIGHEST, "aria-valuetext": name, class: i === this.selected ? "key selected" : "key" });
      draw(group, "circle", { cx: x(time), cy: y(factor), r: 16, class: "reach" });
      draw(group, "circle", { cx: x(time), cy: y(factor), r: 6, class: "point" });
    });
    if (focused !== null) lane.querySelector(`[data-key="${focused}"]`)?.focus();
    this.cursor = draw(lane, "path", { d: `M0 ${LANE_EDGE.top}V${height - LANE_EDGE.bottom}`, class: "cursor" });
    this.x = x;
    this.showTime(this.time());
  }

  /** Moves the cursor to a time. */
  showTime(time) {
    if (!this.cursor) return;
    const isInside = time > -1e-6 && time <= this.sentence.seconds + 1e-6;
    this.cursor.setAttribute("visibility", isInside ? "visible" : "hidden");
    this.cursor.setAttribute("transform", `translate(${this.x(Math.max(time, 0)).toFixed(2)} 0)`);
  }
}
