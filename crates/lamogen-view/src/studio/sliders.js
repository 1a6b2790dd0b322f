// Sliders: the factor of each component, and of parts of the body.

const asFactor = (factor) => `× ${Number(factor.toFixed(2))}`;
const asChange = (ratio) => {
  const percent = Math.round(100 * (ratio - 1));
  return `${percent < 0 ? "−" : "+"}${Math.abs(percent)} %`;
};

/** A slider with its name, its value and marks. */
class Slider {
  /**
   * `marks` are [{ word, factor }]; `moved(factor, isReleased)` is called while the slider is dragged, and when it is released.
   */
  constructor(parent, id, name, marks, moved) {
    const box = append(parent, "div", "slider");
    const head = append(box, "div", "slider-head");
    const label = append(head, "label", "", name);
    label.htmlFor = id;
    this.value = append(head, "output", "", "");
    this.value.htmlFor.add(id);
    this.input = append(box, "input");
    Object.assign(this.input, { type: "range", id, min: LOWEST, max: HIGHEST, step: 0.05 });
    this.scale = append(box, "div", "marks");
    for (const { word, factor } of marks) {
      const mark = append(this.scale, "button", "mark", word);
      mark.type = "button";
      mark.title = `${name} ${asFactor(factor)}`;
      mark.style.setProperty("--at", String((factor - LOWEST) / (HIGHEST - LOWEST)));
      mark.addEventListener("click", () => this.set(factor, true));
    }
    this.note = append(box, "p", "note", "");
    this.marks = marks;
    this.moved = moved;
    // A click or a key changes the value and releases the slider at once.
    this.input.addEventListener("input", () => this.set(Number(this.input.value), false));
    this.input.addEventListener("change", () => this.set(Number(this.input.value), true));
    this.input.addEventListener("dblclick", () => this.set(1, true));
  }

  set(factor, isReleased) {
    this.show(factor);
    this.moved(factor, isReleased);
  }

  /** Shows a factor without asking for a motion. */
  show(factor, isOverTime = false) {
    this.input.value = String(factor);
    this.input.disabled = isOverTime;
    const word = this.marks.find((mark) => Math.abs(mark.factor - factor) < 1e-9)?.word;
    const text = isOverTime ? "over time" : word && word !== "1" ? `${asFactor(factor)}, ${word}` : asFactor(factor);
    this.value.textContent = text;
    this.input.setAttribute("aria-valuetext", text);
    this.input.style.setProperty("--done", `${(100 * (factor - LOWEST)) / (HIGHEST - LOWEST)}%`);
  }
}

/** The sliders of the four components. */
class FactorSliders {
  constructor(parent, components, moved) {
    this.components = components;
    this.sliders = components.map(({ name, key, words }, c) => {
      const marks = [...words, { word: "1", factor: 1 }];
      return new Slider(parent, `factor-${key}`, name, marks, (factor, isReleased) => moved(c, factor, isReleased));
    });
  }

  show(sentence) {
    this.sliders.forEach((slider, c) => slider.show(sentence.factors[c], sentence.keys[c].length > 0));
  }

  /**
   * Shows what was asked and what came out, as means over time, or over the frames `[from, until]` of a sentence. Nothing may have been asked of a component, beside
   * places. A scene that is null has nothing to show.
   */
  showResult(scene, frames = null) {
    this.sliders.forEach((slider, c) => {
      const { key } = this.components[c];
      const average = (motion) => {
        if (!motion?.laban[key] || !frames) return motion?.laban[key]?.mean;
        const values = motion.series[key].slice(...frames).filter(Number.isFinite);
        return values.reduce((sum, value) => sum + value, 0) / values.length;
      };
      const [before, asked, after] = scene ? [scene.motions[0], scene.target, scene.motions[1]].map(average) : [];
      const outcome = before > 0 && after !== undefined ? `came out ${asChange(after / before)}` : "";
      slider.note.textContent = outcome && asked !== undefined ? `asked ${asChange(asked / before)}, ${outcome}` : outcome;
    });
  }
}

/** The sliders of parts of the body. */
class PartSliders {
  constructor({ pick, list }, components, { moved, added, removed }) {
    Object.assign(this, { pick, list, efforts: components.slice(0, EFFORTS), moved, removed });
    pick.addEventListener("change", () => {
      added(pick.value);
      pick.value = "";
    });
  }

  show(sentence) {
    const { pick, list, efforts } = this;
    const left = PARTS.filter((part) => !sentence.parts.some((other) => other.part === part));
    pick.replaceChildren();
    append(pick, "option", "", "a part …").value = "";
    for (const part of left) append(pick, "option", "", part).value = part;
    const names = sentence.parts.map(({ part }) => part).join(" ");
    if (this.names !== names) {
      this.names = names;
      list.replaceChildren();
      this.sliders = sentence.parts.map(({ part }, p) => {
        const group = append(list, "fieldset", "part");
        append(group, "legend", "", part);
        const remove = append(group, "button", "remove", "Remove");
        remove.type = "button";
        remove.setAttribute("aria-label", `Remove ${part}`);
        remove.addEventListener("click", () => this.removed(p));
        return efforts.map(({ name, key, words }, c) =>
          new Slider(group, `part-${part}-${key}`, name, words, (factor, isReleased) => this.moved(p, c, factor, isReleased)));
      });
    }
    sentence.parts.forEach(({ factors }, p) => factors.forEach((factor, c) => this.sliders[p][c].show(factor)));
  }
}
