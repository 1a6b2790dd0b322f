// Positions that hands, feet and head reach: a list of numbers, and marks in the view that can be dragged.

/** The parts of the body that reach positions, and the joint of each. */
const REACH_PARTS = { "left-hand": "left_wrist", "right-hand": "right_wrist", "left-foot": "left_foot", "right-foot": "right_foot", head: "head" };
const MOST_REACHES = 20;
/** Positions are rounded to this, in metres. */
const REACH_STEP = 0.01;
/** How near a mark has to be pressed, in pixels, with a mouse and with a finger. */
const GRASP = { mouse: 14, touch: 26 };

class Reaches {
  /**
   * `moved(isReleased)` is called after the positions of the wish have been changed; `time()` is the moment that is shown, `where(joint, time)` the position of
   * a joint in the shown motion, or undefined; `turned()` is called when another mark is chosen.
   */
  constructor(elements, stage, calls) {
    Object.assign(this, { ...elements, stage, ...calls });
    this.selected = null;
    this.outcomes = [];
    this.pick.addEventListener("change", () => {
      const part = this.pick.value;
      this.pick.value = "";
      if (part) this.insert(part);
    });
    this.clear.addEventListener("click", () => {
      this.wish.reaches = [];
      this.selected = null;
      this.change(true);
    });
    // Marks lie above the figures: whoever presses one does not turn the camera.
    const { view } = this;
    const on = (name, listen) => view.addEventListener(name, listen, { capture: true });
    on("pointerdown", (event) => this.press(event));
    on("pointermove", (event) => this.drag(event));
    on("pointerup", (event) => this.release(event));
    on("pointercancel", (event) => this.release(event));
  }

  get reaches() {
    return this.wish.reaches;
  }

  change(isReleased) {
    if (isReleased) prune(this.wish);
    this.show(this.wish);
    this.moved(isReleased);
  }

  /** Adds a position for a part at the moment that is shown, or after it: where the part is then. */
  insert(part) {
    if (this.reaches.length >= MOST_REACHES) return;
    const total = number(totalSeconds(this.wish));
    let time = number(Math.min(Math.round(this.time() / KEY_STEP) * KEY_STEP, total));
    const isTaken = () => this.reaches.some((other) => other.part === part && Math.abs(other.time - time) < KEY_STEP / 2);
    while (isTaken() && time + KEY_STEP <= total) time = number(time + KEY_STEP);
    if (isTaken()) return;
    const [x, y, z] = this.where(REACH_PARTS[part], time) ?? [0, 1, 0.4];
    this.reaches.push({ part, time, ...this.snap({ x, y, z }) });
    this.selected = this.reaches.length - 1;
    this.change(true);
  }

  snap(position) {
    const round = (metres, least) => number(Math.round(Math.min(Math.max(metres, least), 100) / REACH_STEP) * REACH_STEP);
    return { x: round(position.x, -100), y: round(position.y, 0), z: round(position.z, -100) };
  }

  move(i, change, isReleased) {
    const reach = { ...this.reaches[i], ...change };
    const time = number(Math.min(Math.max(Math.round(reach.time / KEY_STEP) * KEY_STEP, 0), totalSeconds(this.wish)));
    this.reaches[i] = { part: reach.part, time, ...this.snap(reach) };
    this.change(isReleased);
  }

  removeAt(i) {
    this.reaches.splice(i, 1);
    this.selected = this.reaches.length ? Math.min(i, this.reaches.length - 1) : null;
    this.change(true);
  }

  /** Returns the mark under a pointer: its number and its projection. */
  find(event) {
    const box = this.view.getBoundingClientRect();
    const at = [event.clientX - box.left, event.clientY - box.top];
    const lens = this.stage.lensAt(at);
    if (!lens) return null;
    const marks = this.reaches.map(({ x, y, z }, i) => ({ i, lens, ...lens.project([x, y, z]) }));
    const away = (mark) => Math.hypot(mark.x - at[0], mark.y - at[1]);
    const near = marks.filter((mark) => mark.depth > 0.1 && away(mark) < (GRASP[event.pointerType] ?? GRASP.mouse));
    return near.sort((a, b) => away(a) - away(b))[0] ?? null;
  }

  press(event) {
    if (event.button !== 0 || event.target.closest("button") || this.held) return;
    const mark = this.find(event);
    if (!mark) return;
    event.preventDefault();
    event.stopPropagation();
    this.view.setPointerCapture(event.pointerId);
    this.selected = mark.i;
    const { x, y, z } = this.reaches[mark.i];
    this.held = { pointer: event.pointerId, from: [event.clientX, event.clientY], position: [x, y, z], mark };
    this.show(this.wish);
    this.turned();
  }

  /** Moves the held mark in parallel to the picture. */
  drag(event) {
    const { held } = this;
    if (held?.pointer !== event.pointerId) {
      if (event.pointerType === "mouse" && event.buttons === 0) this.view.classList.toggle("on-mark", this.find(event) !== null);
      return;
    }
    event.stopPropagation();
    const { lens, scale, i } = held.mark;
    const [right, down] = [event.clientX - held.from[0], event.clientY - held.from[1]];
    const [x, y, z] = add(held.position, add(times(lens.right, right / scale), times(lens.up, -down / scale)));
    held.isMoved = true;
    this.move(i, { x, y, z }, false);
  }

  release(event) {
    const { held } = this;
    if (held?.pointer !== event.pointerId) return;
    event.stopPropagation();
    this.held = undefined;
    if (held.isMoved) this.change(true);
  }

  /** Shows how near a motion comes to the positions: the places of its report. */
  showResult(outcomes) {
    this.outcomes = outcomes;
    this.show(this.wish);
  }

  /** Returns by how many metres the shown motion misses a position, if it was asked for it. */
  missed({ part, time, x, y, z }) {
    const near = (a, b) => Math.abs(a - b) < 1e-3;
    return this.outcomes.find(({ place, seconds, asked_m: asked }) => place === part && near(seconds, time) && [x, y, z].every((metres, axis) => near(metres, asked[axis])))?.off_m;
  }

  show(wish) {
    this.wish = wish;
    if (this.selected !== null && this.selected >= this.reaches.length) this.selected = null;
    Object.assign(this.stage.scene, { reaches: wish.reaches, selectedReach: this.selected });
    const { pick, list, reaches } = this;
    if (pick.options.length === 0) {
      append(pick, "option", "", "a part …").value = "";
      for (const part of Object.keys(REACH_PARTS)) append(pick, "option", "", part).value = part;
    }
    pick.disabled = reaches.length >= MOST_REACHES;
    this.clear.disabled = reaches.length === 0;
    this.note.textContent = reaches.length ? "Drag the marks in the view, or say where: up from the floor, left and forward from where the body starts." : "A part is added where it is at the moment that is shown. Then drag its mark.";
    const total = number(totalSeconds(wish));
    const entries = reaches.map((reach, i) => ({
      name: `${reach.part} ${i + 1}`,
      title: reach.part,
      isSelected: i === this.selected,
      fields: [
        { key: "time", text: "at", unit: "s", value: reach.time, low: 0, high: total, step: KEY_STEP },
        { key: "x", text: "left", unit: "m", value: reach.x, low: -100, high: 100, step: REACH_STEP },
        { key: "y", text: "up", unit: "m", value: reach.y, low: 0, high: 100, step: REACH_STEP },
        { key: "z", text: "forward", unit: "m", value: reach.z, low: -100, high: 100, step: REACH_STEP },
      ],
      off: this.missed(reach),
      change: (key, value) => this.move(i, { [key]: value }, true),
      removed: () => this.removeAt(i),
    }));
    showPlaceList(list, entries, () => this.show(this.wish));
  }
}
