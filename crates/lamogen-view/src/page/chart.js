// Charts of Weight, Time, Flow and Shape over time, with a cursor that can be dragged.

/** The space around the curves, in pixels. */
const EDGE = { left: 40, right: 14, top: 8, bottom: 20 };

/** Appends an SVG element with attributes to another element. */
function draw(parent, name, attributes = {}) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return parent.appendChild(element);
}

/** Appends an HTML element with a class and a text to another element. */
function append(parent, name, className = "", text = "") {
  const element = document.createElement(name);
  if (className) element.className = className;
  element.textContent = text;
  return parent.appendChild(element);
}

/** Returns a round step that divides a range into about `parts` parts. */
function roundStep(range, parts) {
  const rough = range / parts;
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].find((step) => step * power >= rough * 0.999) * power;
}

/** The chart of one component. */
class Chart {
  /**
   * Curves are [{ label, colour, dashed, values }], with one value for each frame; `duration` is in seconds.
   * `seek` is called with the time at which the pointer is. `borders` are moments that are marked by lines, in seconds.
   */
  constructor(parent, component, curves, rate, duration, seek, borders = []) {
    Object.assign(this, { curves, rate, borders });
    this.duration = Math.max(duration, 1 / rate);
    const finite = curves.flatMap((curve) => curve.values.filter(Number.isFinite));
    const largest = finite.reduce((a, b) => Math.max(a, b), 0) || 1;
    this.step = roundStep(largest * 1.06, 3);
    this.top = largest * 1.06;
    this.digits = Math.min(Math.max(2 - Math.floor(Math.log10(largest)), 0), 12);

    const figure = append(parent, "figure", "chart");
    const caption = append(figure, "figcaption");
    append(caption, "b", "", component.name);
    append(caption, "span", "", `${component.less} to ${component.more}`);
    append(caption, "span", "", component.unit);
    this.svg = draw(figure, "svg", { role: "img" });
    const peaks = curves.map((curve) => {
      const peak = curve.values.filter(Number.isFinite).reduce((a, b) => Math.max(a, b), 0);
      return `${curve.label} at most ${this.number(peak)}`;
    });
    this.svg.setAttribute("aria-label", `${component.name} over time in ${component.unit}: ${peaks.join(", ")}`);
    const list = append(figure, "ul", "values");
    this.read = curves.map((curve) => {
      const item = append(list, "li");
      const swatch = draw(item, "svg", { class: "swatch", viewBox: "0 0 20 8", "aria-hidden": "true" });
      const line = draw(swatch, "path", { d: "M1 4h18", class: "line", "stroke-dasharray": curve.dashed ? "5 4" : "none" });
      append(item, "bdi", "", curve.label);
      return { line, number: append(item, "b") };
    });

    const point = (event) => {
      const box = this.svg.getBoundingClientRect();
      const across = (event.clientX - box.left - EDGE.left) / (box.width - EDGE.left - EDGE.right);
      seek(Math.min(Math.max(across, 0), 1) * this.duration);
    };
    this.svg.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      this.svg.setPointerCapture(event.pointerId);
      point(event);
    });
    this.svg.addEventListener("pointermove", (event) => {
      if (this.svg.hasPointerCapture(event.pointerId)) point(event);
    });
  }

  number(value) {
    return Number.isFinite(value) ? value.toFixed(this.digits) : "–";
  }

  /** Draws everything again for the current size of the chart. */
  layout(dark) {
    const { svg, curves, rate, duration } = this;
    const { width, height } = svg.getBoundingClientRect();
    this.x = (time) => EDGE.left + (time / duration) * Math.max(width - EDGE.left - EDGE.right, 1);
    this.y = (value) => height - EDGE.bottom - (value / this.top) * Math.max(height - EDGE.top - EDGE.bottom, 1);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    svg.replaceChildren();
    for (let value = 0; value <= this.top; value += this.step) {
      const y = this.y(value);
      draw(svg, "path", { d: `M${EDGE.left} ${y}H${width - EDGE.right}`, class: "rule" });
      const text = draw(svg, "text", { x: EDGE.left - 6, y: y + 4, "text-anchor": "end" });
      text.textContent = String(Number(value.toPrecision(3)));
    }
    const step = roundStep(duration, Math.max(width / 80, 2));
    for (let i = 0; i * step <= duration + 1e-6; i++) {
      const x = this.x(i * step);
      const text = draw(svg, "text", { x: Math.min(x, width), y: height - 5, "text-anchor": x > width - 20 ? "end" : "middle" });
      text.textContent = `${Number((i * step).toPrecision(3))} s`;
    }
    for (const time of this.borders) draw(svg, "path", { d: `M${this.x(time).toFixed(1)} ${EDGE.top}V${height - EDGE.bottom}`, class: "border" });
    curves.forEach((curve, i) => {
      const colour = css(readable(curve.colour, dark));
      let pen = "M";
      let path = "";
      curve.values.forEach((value, frame) => {
        if (Number.isFinite(value)) path += `${pen}${this.x(frame / rate).toFixed(1)} ${this.y(value).toFixed(1)}`;
        pen = Number.isFinite(value) ? "L" : "M";
      });
      draw(svg, "path", { d: path, class: "line", stroke: colour, "stroke-dasharray": curve.dashed ? "6 5" : "none" });
      this.read[i].line.setAttribute("stroke", colour);
    });
    this.cursor = draw(svg, "path", { d: `M0 ${EDGE.top}V${height - EDGE.bottom}`, class: "cursor" });
    this.dots = curves.map((curve) => draw(svg, "circle", { r: 4, class: "dot", fill: css(readable(curve.colour, dark)) }));
  }

  /** Moves the cursor to a time and shows the values there. */
  show(time) {
    const x = this.x(Math.min(time, this.duration));
    this.cursor.setAttribute("transform", `translate(${x.toFixed(2)} 0)`);
    this.curves.forEach((curve, i) => {
      const place = Math.min(time * this.rate, curve.values.length - 1);
      const frame = Math.floor(place);
      const [from, to] = [curve.values[frame], curve.values[Math.min(frame + 1, curve.values.length - 1)]];
      const value = place === frame ? from : from + (to - from) * (place - frame);
      const dot = this.dots[i];
      dot.setAttribute("visibility", Number.isFinite(value) ? "visible" : "hidden");
      if (Number.isFinite(value)) {
        dot.setAttribute("cx", this.x(place / this.rate).toFixed(2));
        dot.setAttribute("cy", this.y(value).toFixed(2));
      }
      this.read[i].number.textContent = this.number(value);
    });
  }
}
