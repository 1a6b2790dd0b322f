// The sentences of a motion in a row: segments that can be chosen, added, removed and moved, with ends that can be dragged.

/** The sentence that a new segment begins with. */
const NEXT_SENTENCE = "a person walks forward";

class Segments {
  /**
   * `chosen(i)` is called when a sentence is chosen, `changed(isReleased)` after the wish has been changed, `added()` after that of a new sentence,
   * `refused(text)` if a change cannot be.
   */
  constructor(elements, components, shortest, calls) {
    Object.assign(this, { ...elements, components, shortest, ...calls });
    /** The sentence that sliders, keys and parts belong to. */
    this.place = 0;
    this.track.addEventListener("pointerdown", (event) => this.press(event));
    this.track.addEventListener("pointermove", (event) => this.drag(event));
    const release = () => {
      if (this.held === undefined) return;
      this.held = undefined;
      this.change(true);
    };
    this.track.addEventListener("pointerup", release);
    this.track.addEventListener("pointercancel", release);
    this.track.addEventListener("keydown", (event) => this.pressKey(event));
    this.track.addEventListener("click", (event) => {
      const segment = event.target.closest("[data-segment]");
      if (segment) this.choose(Number(segment.dataset.segment));
    });
    this.add.addEventListener("click", () => this.insert());
    this.remove.addEventListener("click", () => this.removeAt(this.place));
    this.earlier.addEventListener("click", () => this.move(-1));
    this.later.addEventListener("click", () => this.move(1));
  }

  /** The chosen sentence of the wish. */
  get sentence() {
    return this.wish.sentences[this.place];
  }

  /** The moment at which the chosen sentence begins, in seconds. */
  get start() {
    return beginning(this.wish, this.place);
  }

  change(isReleased) {
    if (isReleased) prune(this.wish);
    this.show(this.wish);
    this.changed(isReleased);
  }

  choose(i) {
    this.place = i;
    this.show(this.wish);
    this.chosen(i);
  }

  insert() {
    this.wish.sentences.splice(this.place + 1, 0, newSentence(this.components, NEXT_SENTENCE, Math.max(this.shortest, 3)));
    this.place += 1;
    this.change(true);
    this.added();
  }

  removeAt(i) {
    const { sentences } = this.wish;
    if (sentences.length === 1) return;
    sentences.splice(i, 1);
    if (this.place > i || this.place === sentences.length) this.place -= 1;
    this.change(true);
  }

  /** Moves the chosen sentence among the others. */
  move(by) {
    const { sentences } = this.wish;
    const to = this.place + by;
    if (to < 0 || to >= sentences.length) return;
    sentences.splice(to, 0, ...sentences.splice(this.place, 1));
    this.place = to;
    this.change(true);
  }

  /** Gives a sentence another length, rounded to frames. */
  resize(i, seconds, isReleased) {
    const rounded = number(Math.round(seconds / KEY_STEP) * KEY_STEP);
    this.wish.sentences[i].seconds = Math.min(Math.max(rounded, this.shortest), LONGEST_SENTENCE);
    this.change(isReleased);
  }

  press(event) {
    const end = event.target.closest("[data-end]");
    if (event.button !== 0 || !end) return;
    event.preventDefault();
    this.track.setPointerCapture(event.pointerId);
    const i = Number(end.dataset.end);
    // While an end is held, a second is as wide as it was.
    this.held = { pointer: event.pointerId, i, from: event.clientX, seconds: this.wish.sentences[i].seconds, total: totalSeconds(this.wish) };
    end.focus();
  }

  drag(event) {
    const { held } = this;
    if (held?.pointer !== event.pointerId) return;
    const across = (event.clientX - held.from) / this.track.getBoundingClientRect().width;
    this.resize(held.i, held.seconds + across * held.total, false);
  }

  pressKey(event) {
    const end = event.target.closest("[data-end]");
    const segment = event.target.closest("[data-segment]");
    const actions = {};
    if (end) {
      const i = Number(end.dataset.end);
      const by = (seconds) => () => this.resize(i, this.wish.sentences[i].seconds + seconds, true);
      Object.assign(actions, { ArrowLeft: by(-0.1), ArrowDown: by(-0.1), ArrowRight: by(0.1), ArrowUp: by(0.1), PageDown: by(-1), PageUp: by(1) });
    }
    if (segment) {
      const i = Number(segment.dataset.segment);
      actions.Delete = actions.Backspace = () => this.removeAt(i);
    }
    if (!actions[event.key]) return;
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
  }

  show(wish) {
    this.wish = wish;
    const { track } = this;
    const { sentences } = wish;
    this.place = Math.min(this.place, sentences.length - 1);
    const isRow = sentences.length > 1;
    for (const element of [this.title, this.remove, this.earlier, this.later]) element.hidden = !isRow;
    this.earlier.disabled = this.place === 0;
    this.later.disabled = this.place === sentences.length - 1;
    this.title.textContent = `Sentence ${this.place + 1} of ${sentences.length}`;
    const focused = track.contains(document.activeElement) ? { ...document.activeElement.dataset } : {};
    track.replaceChildren();
    const total = this.held?.total ?? totalSeconds(wish);
    let start = 0;
    sentences.forEach(({ prompt, seconds }, i) => {
      const until = start + seconds;
      const segment = append(track, "button", "segment");
      segment.type = "button";
      segment.dataset.segment = i;
      segment.title = prompt;
      segment.setAttribute("aria-label", `Sentence ${i + 1} of ${sentences.length}: ${prompt || "no words"}, from ${number(start)} to ${number(until)} seconds`);
      segment.setAttribute("aria-pressed", String(i === this.place));
      segment.style.left = `${(100 * start) / total}%`;
      segment.style.width = `${(100 * seconds) / total}%`;
      append(segment, "span", "", prompt);
      append(segment, "small", "", `${number(seconds)} s`);
      start = until;
    });
    start = 0;
    sentences.forEach(({ seconds }, i) => {
      start += seconds;
      const end = append(track, "div", "end");
      end.dataset.end = i;
      end.tabIndex = 0;
      end.style.left = `${(100 * start) / total}%`;
      const values = { role: "slider", "aria-label": `Length of sentence ${i + 1}`, "aria-valuemin": this.shortest, "aria-valuemax": LONGEST_SENTENCE, "aria-valuenow": number(seconds), "aria-valuetext": `${number(seconds)} seconds` };
      for (const [name, value] of Object.entries(values)) end.setAttribute(name, value);
    });
    this.cursor = append(track, "div", "cursor");
    const again = focused.segment !== undefined ? `[data-segment="${Math.min(focused.segment, sentences.length - 1)}"]` : focused.end !== undefined ? `[data-end="${focused.end}"]` : null;
    if (again) track.querySelector(again)?.focus();
    this.showTime(this.time());
  }

  /** Moves the cursor to a time of the whole motion. */
  showTime(time) {
    const total = this.held?.total ?? totalSeconds(this.wish);
    this.cursor.style.left = `${Math.min((100 * time) / total, 100)}%`;
  }
}
