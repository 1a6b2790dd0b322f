// What is said when: captions side by side, and the one of the moment below the figures.

class Captions {
  /** Captions are [{ text, from, until }] in frames, in the order of time. `seek` is called with the first frame of one that is chosen. */
  constructor({ list, line }, captions, seek) {
    Object.assign(this, { list, line, captions });
    list.hidden = line.hidden = captions.length === 0;
    this.shown = null;
    this.items = captions.map(({ text, from, until }) => {
      const item = append(list, "li");
      item.style.flexGrow = String(Math.max(until - from, 1));
      const button = append(item, "button", "", text);
      Object.assign(button, { type: "button", dir: "auto", title: text });
      button.addEventListener("click", (event) => {
        seek(from);
        // After a click with the mouse, the space bar must again play and pause.
        if (event.detail > 0) button.blur();
      });
      return button;
    });
  }

  /** Returns the place of the caption that holds at a frame; -1 if none does. */
  at(frame) {
    return this.captions.findIndex(({ from, until }) => from <= frame && frame < until);
  }

  show(frame) {
    const now = this.at(frame);
    if (now === this.shown) return;
    this.shown = now;
    this.line.textContent = this.captions[now]?.text ?? "";
    this.line.hidden = this.line.textContent === "";
    this.items.forEach((item, i) => {
      if (i === now) item.setAttribute("aria-current", "true");
      else item.removeAttribute("aria-current");
    });
    // Only the list scrolls, not the page.
    const item = this.items[now]?.parentElement;
    if (item) this.list.scrollLeft = item.offsetLeft - (this.list.clientWidth - item.offsetWidth) / 2;
  }
}
