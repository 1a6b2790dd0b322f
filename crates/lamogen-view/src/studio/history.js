// The motions before: thumbnails, each with its wish and its motion, and undo.

/** The number of motions that are kept. */
const HISTORY = 40;
/** The side of a thumbnail in pixels. */
const THUMBNAIL = 96;

class History {
  /** `chosen(entry)` is called when one of the motions is chosen. */
  constructor(list, undo, describe, chosen) {
    Object.assign(this, { list, undo, describe, chosen });
    /** [{ wish, scene, picture }], the newest last. */
    this.entries = [];
    this.place = -1;
    undo.addEventListener("click", () => this.back());
  }

  /** Adds a motion after the shown one. A motion that was undone is not lost: it stays in the list. */
  add(entry) {
    this.entries.push(entry);
    if (this.entries.length > HISTORY) this.entries.shift();
    this.place = this.entries.length - 1;
    this.show();
  }

  /** The motion that is shown, if it is one of them. */
  get shown() {
    return this.entries[this.place];
  }

  back() {
    if (this.place > 0) this.go(this.place - 1);
  }

  go(place) {
    this.place = place;
    this.show();
    this.chosen(this.entries[place]);
  }

  show() {
    this.undo.disabled = this.place <= 0;
    this.list.replaceChildren();
    for (let place = this.entries.length - 1; place >= 0; place--) {
      const { wish, picture } = this.entries[place];
      const item = append(this.list, "li");
      const button = append(item, "button", "thumbnail");
      button.type = "button";
      const text = this.describe(wish);
      button.title = text;
      button.setAttribute("aria-label", text);
      if (place === this.place) button.setAttribute("aria-current", "true");
      const image = append(button, "img");
      Object.assign(image, { src: picture, alt: "", width: THUMBNAIL, height: THUMBNAIL });
      button.addEventListener("click", () => this.go(place));
    }
  }
}

/** Draws a few moments of a motion into a small picture. */
function thumbnail(motion, index, dark) {
  const canvas = document.createElement("canvas");
  const ratio = 2;
  canvas.width = canvas.height = THUMBNAIL * ratio;
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  const cell = { x: 0, y: 0, width: THUMBNAIL, height: THUMBNAIL };
  const time = motion.duration * 0.5;
  const [x, z] = motion.along(time);
  const focus = [x, 0.9, z];
  const fit = distanceToFit(motion.pose(time).map((point) => sub(point, focus)), cell);
  const lens = new Lens(new Camera(), Math.max(fit, 2.2), focus, cell);
  const appearance = { grid: dark ? "170, 185, 210" : "70, 80, 100", shadow: 0.4, trails: true };
  new Scene(context, index).draw([{ motion, colour: readable(motion.colour, dark) }], time, lens, cell, appearance);
  return canvas.toDataURL("image/png");
}
