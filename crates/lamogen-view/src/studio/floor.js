// Places on the floor, seen from above: forward is up, the left of the body is left. They can be set, dragged, moved by keys and removed.

/** Places are rounded to this, in metres. */
const PLACE_STEP = 0.05;
const MOST_PLACES = 20;
/** The time between two places that were clicked, at least, in seconds. */
const SHORTEST_WAY = 0.5;
/** The speed of a run in metres a second; feet slide on a faster path. */
const RUN = 3;

class Floor {
  /** `moved(isReleased)` is called after the path of the wish has been changed; `time()` is the moment that is shown. */
  constructor(elements, calls) {
    Object.assign(this, { ...elements, ...calls });
    this.selected = null;
    /** [x, z] of the pelvis at every frame. */
    this.trace = [];
    this.outcomes = [];
    this.map.addEventListener("pointerdown", (event) => this.press(event));
    this.map.addEventListener("pointermove", (event) => {
      if (event.pointerId !== this.held) return;
      const [x, z] = this.point(event);
      this.move(this.selected, { x, z }, false);
    });
    const release = () => {
      if (this.held === undefined) return;
      this.held = undefined;
      this.change(true);
    };
    this.map.addEventListener("pointerup", release);
    this.map.addEventListener("pointercancel", release);
    this.map.addEventListener("keydown", (event) => this.pressKey(event));
    this.add.addEventListener("click", () => {
      // A metre further on the way.
      const [before, last] = [{ x: 0, z: -1 }, { x: 0, z: 0 }, ...this.path].slice(-2);
      const way = Math.hypot(last.x - before.x, last.z - before.z);
      const [x, z] = way > 0 ? [(last.x - before.x) / way, (last.z - before.z) / way] : [0, 1];
      this.insert(last.x + x, last.z + z);
    });
    const turn = () => {
      const degrees = Number(this.degrees.value);
      this.wish.face = this.face.value === "degrees" ? number(Math.min(Math.max(Number.isFinite(degrees) ? degrees : 0, -MOST_DEGREES), MOST_DEGREES)) : this.face.value;
      this.change(true);
    };
    this.face.addEventListener("change", turn);
    this.degrees.addEventListener("change", turn);
    this.clear.addEventListener("click", () => {
      this.wish.path = [];
      this.selected = null;
      this.change(true);
    });
  }

  get path() {
    return this.wish.path;
  }

  change(isReleased) {
    if (isReleased) prune(this.wish);
    this.show(this.wish);
    this.moved(isReleased);
  }

  /** Adds a place at the end of the motion. Those before it come earlier, as far as they would come if all was gone at one speed. */
  insert(x, z) {
    const { path } = this;
    if (path.length >= MOST_PLACES) return;
    const total = number(totalSeconds(this.wish));
    const place = { time: total, ...this.snap(x, z) };
    const last = path.at(-1);
    if (last && total - last.time < SHORTEST_WAY) {
      const all = [{ x: 0, z: 0 }, ...path, place];
      const ways = all.slice(1).map((to, i) => Math.hypot(to.x - all[i].x, to.z - all[i].z));
      const whole = ways.reduce((sum, way) => sum + way, 0);
      const share = Math.min(whole > 0 ? 1 - ways.at(-1) / whole : 1, 1 - SHORTEST_WAY / total);
      let before = 0;
      for (const earlier of path) before = earlier.time = Math.max(this.snapTime(earlier.time * share), number(before + KEY_STEP));
      if (before >= total) return;
    }
    path.push(place);
    this.selected = path.length - 1;
    this.change(true);
  }

  snap(x, z) {
    const round = (metres) => number(Math.round(Math.min(Math.max(metres, -100), 100) / PLACE_STEP) * PLACE_STEP);
    return { x: round(x), z: round(z) };
  }

  snapTime(time) {
    return number(Math.round(time / KEY_STEP) * KEY_STEP);
  }

  /** Moves a place, in space or in time; in time not past its neighbours. */
  move(i, { x = this.path[i].x, z = this.path[i].z, time = this.path[i].time }, isReleased) {
    const low = i > 0 ? this.path[i - 1].time + KEY_STEP : KEY_STEP;
    const high = i < this.path.length - 1 ? this.path[i + 1].time - KEY_STEP : totalSeconds(this.wish);
    this.path[i] = { time: number(Math.min(Math.max(this.snapTime(time), low), high)), ...this.snap(x, z) };
    this.change(isReleased);
  }

  removeAt(i) {
    this.path.splice(i, 1);
    this.selected = this.path.length ? Math.min(i, this.path.length - 1) : null;
    this.change(true);
  }

  /** Returns [x, z] in metres where a pointer is. */
  point(event) {
    const box = this.map.getBoundingClientRect();
    const { middle, scale } = this.frame;
    return [middle[0] - (event.clientX - box.left - box.width / 2) / scale, middle[1] - (event.clientY - box.top - box.height / 2) / scale];
  }

  press(event) {
    if (event.button !== 0) return;
    event.preventDefault();
    this.map.setPointerCapture(event.pointerId);
    const place = event.target.closest("[data-place]");
    this.held = event.pointerId;
    if (place) {
      this.selected = Number(place.dataset.place);
      this.show(this.wish);
    } else {
      this.insert(...this.point(event));
    }
    this.map.querySelector(`[data-place="${this.selected}"]`)?.focus();
  }

  pressKey(event) {
    const place = event.target.closest("[data-place]");
    if (!place) return;
    const i = (this.selected = Number(place.dataset.place));
    const { x, z, time } = this.path[i];
    const step = event.shiftKey ? 0.5 : 0.1;
    const actions = {
      ArrowLeft: () => this.move(i, { x: x + step }, true),
      ArrowRight: () => this.move(i, { x: x - step }, true),
      ArrowUp: () => this.move(i, { z: z + step }, true),
      ArrowDown: () => this.move(i, { z: z - step }, true),
      PageUp: () => this.move(i, { time: time + 0.1 }, true),
      PageDown: () => this.move(i, { time: time - 0.1 }, true),
      Delete: () => this.removeAt(i),
      Backspace: () => this.removeAt(i),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
    this.map.querySelector(`[data-place="${this.selected}"]`)?.focus();
  }

  /** Shows where a motion goes, and how near it comes to the places: the trace of its pelvis and the places of its report. */
  showResult(trace, outcomes) {
    Object.assign(this, { trace, outcomes });
    this.show(this.wish);
  }

  /** Returns by how many metres the shown motion misses a place, if it was asked for it. */
  missed({ time, x, z }) {
    const near = (a, b) => Math.abs(a - b) < 1e-3;
    return this.outcomes.find(({ place, seconds, asked_m: [left, , forward] }) => place === "pelvis" && near(seconds, time) && near(left, x) && near(forward, z))?.off_m;
  }

  show(wish) {
    this.wish = wish;
    if (this.selected !== null && this.selected >= this.path.length) this.selected = null;
    this.add.disabled = this.path.length >= MOST_PLACES;
    this.clear.disabled = this.path.length === 0;
    this.facing.hidden = this.path.length === 0;
    const isDirection = typeof wish.face === "number";
    this.face.value = isDirection ? "degrees" : wish.face;
    this.degrees.closest("label").hidden = !isDirection;
    if (document.activeElement !== this.degrees) this.degrees.value = isDirection ? wish.face : 0;
    this.showList();
    this.showMap();
  }

  showList() {
    const { list, path } = this;
    const total = number(totalSeconds(this.wish));
    const entries = path.map((place, i) => ({
      name: `Place ${i + 1}`,
      title: String(i + 1),
      isSelected: i === this.selected,
      fields: [
        { key: "time", text: "at", unit: "s", value: place.time, low: 0, high: total, step: KEY_STEP },
        { key: "x", text: "left", unit: "m", value: place.x, low: -100, high: 100, step: PLACE_STEP },
        { key: "z", text: "forward", unit: "m", value: place.z, low: -100, high: 100, step: PLACE_STEP },
      ],
      off: this.missed(place),
      change: (key, value) => this.move(i, { [key]: value }, true),
      removed: () => this.removeAt(i),
    }));
    showPlaceList(list, entries, () => this.show(this.wish));
    const all = [{ time: 0, x: 0, z: 0 }, ...path];
    const speeds = path.map((to, i) => Math.hypot(to.x - all[i].x, to.z - all[i].z) / (to.time - all[i].time));
    const fastest = Math.max(0, ...speeds);
    this.note.textContent = fastest > RUN ? `The path goes ${fastest.toFixed(1)} m/s at its fastest, faster than a run: feet may slide there.` : path.length ? "Say how the person goes there: “a person walks forward”." : "Click where the person shall go.";
  }

  /** Chooses what is seen: all of the way, with room around it. While a place is held, it stays. */
  chooseFrame(width, height) {
    if (this.held !== undefined && this.frame) return;
    const points = [[0, 0], ...this.trace, ...this.path.map(({ x, z }) => [x, z])];
    const [low, high] = [Math.min, Math.max].map((most) => [0, 1].map((axis) => points.reduce((found, point) => most(found, point[axis]), 0)));
    const reach = [0, 1].map((axis) => Math.max((high[axis] - low[axis]) / 2 + 0.6, 1.2));
    this.frame = { middle: [0, 1].map((axis) => (low[axis] + high[axis]) / 2), scale: Math.min(width / 2 / reach[0], height / 2 / reach[1]) };
  }

  showMap() {
    const { map, path } = this;
    const focused = map.contains(document.activeElement) ? document.activeElement.dataset.place : null;
    const { width, height } = map.getBoundingClientRect();
    if (width === 0) return;
    this.chooseFrame(width, height);
    const { middle, scale } = this.frame;
    const across = (x) => width / 2 - (x - middle[0]) * scale;
    const down = (z) => height / 2 - (z - middle[1]) * scale;
    map.setAttribute("viewBox", `0 0 ${width} ${height}`);
    map.replaceChildren();
    const side = roundStep(width / scale, Math.max(width / 70, 2));
    const [left, right] = [middle[0] + width / 2 / scale, middle[0] - width / 2 / scale];
    const [top, bottom] = [middle[1] + height / 2 / scale, middle[1] - height / 2 / scale];
    for (let i = Math.ceil(right / side); i * side <= left; i++) {
      draw(map, "path", { d: `M${across(i * side)} 0V${height}`, class: i === 0 ? "rule axis" : "rule" });
      if (i !== 0) draw(map, "text", { x: across(i * side) + 3, y: height - 5 }).textContent = `${number(Math.abs(i * side))} m ${i > 0 ? "left" : "right"}`;
    }
    for (let i = Math.ceil(bottom / side); i * side <= top; i++) {
      draw(map, "path", { d: `M0 ${down(i * side)}H${width}`, class: i === 0 ? "rule axis" : "rule" });
      if (i !== 0 && down(i * side) < height - 20) draw(map, "text", { x: 4, y: down(i * side) - 4 }).textContent = `${number(Math.abs(i * side))} m ${i > 0 ? "forward" : "back"}`;
    }
    const [x0, y0] = [across(0), down(0)];
    draw(map, "path", { d: `M${x0} ${y0 - 11}L${x0 + 7} ${y0 + 6}L${x0} ${y0 + 2}L${x0 - 7} ${y0 + 6}Z`, class: "start" });
    if (this.trace.length) draw(map, "path", { d: `M${this.trace.map(([x, z]) => `${across(x).toFixed(1)} ${down(z).toFixed(1)}`).join("L")}`, class: "trace" });
    if (path.length) draw(map, "path", { d: `M${[{ x: 0, z: 0 }, ...path].map(({ x, z }) => `${across(x).toFixed(1)} ${down(z).toFixed(1)}`).join("L")}`, class: "way" });
    path.forEach((place, i) => {
      const { time, x, z } = place;
      const away = (metres, [more, less]) => `${number(Math.abs(metres))} metres ${metres < 0 ? less : more}`;
      const name = `Place ${i + 1} at ${number(time)} seconds: ${away(x, ["left", "right"])}, ${away(z, ["forward", "back"])}`;
      const group = draw(map, "g", { "data-place": i, tabindex: 0, role: "slider", "aria-label": name, "aria-valuetext": name, "aria-valuenow": number(z), "aria-valuemin": -100, "aria-valuemax": 100, class: i === this.selected ? "place selected" : "place" });
      draw(group, "circle", { cx: across(x), cy: down(z), r: 16, class: "reach" });
      draw(group, "circle", { cx: across(x), cy: down(z), r: 7, class: "point" });
      const isRight = across(x) > width - 60;
      draw(group, "text", { x: across(x) + (isRight ? -11 : 11), y: down(z) - 8, "text-anchor": isRight ? "end" : "start", class: "when" }).textContent = `${number(time)} s`;
    });
    this.dot = draw(map, "circle", { r: 4, class: "body" });
    this.across = across;
    this.down = down;
    if (focused !== null) map.querySelector(`[data-place="${focused}"]`)?.focus();
    this.showTime(this.time());
  }

  /** Moves the dot to where the pelvis is at a time. */
  showTime(time) {
    if (!this.dot) return;
    const [x, z] = this.trace[Math.min(Math.round(time / KEY_STEP), this.trace.length - 1)] ?? [0, 0];
    this.dot.setAttribute("cx", this.across(x).toFixed(1));
    this.dot.setAttribute("cy", this.down(z).toFixed(1));
  }
}
