// The program of the page: it connects data, scene, charts and controls.

const data = JSON.parse(byId("data").textContent);
const index = Object.fromEntries(data.joints.map((name, joint) => [name, joint]));
const motions = data.motions.map((encoded) => new Motion(encoded, data.joints.length, data.rate));
const curves = data.curves.map((curve) => ({ ...curve, values: decodeFloats(curve.values) }));
const components = data.components.length;
const frames = Math.max(1, ...motions.map((motion) => motion.frames), ...curves.map((curve) => curve.values.length / components));

const canvas = byId("view");
const context = canvas.getContext("2d");
const scene = new Scene(context, index);
const camera = new Camera();
const darkness = matchMedia("(prefers-color-scheme: dark)");
let drawing = 0;
let lastMoment = 0;
let lens = null;

const player = new Player(frames, data.rate, () => redraw());
const charts = curves.length === 0 ? [] : data.components.map((component, c) => {
  const lines = curves.map((curve) => ({ ...curve, values: Array.from(curve.values.filter((_, i) => i % components === c)) }));
  return new Chart(byId("charts"), component, lines, data.rate, player.duration, (time) => player.goTo(time * data.rate));
});

// The bounding box of all motions.
const bounds = { low: [Infinity, 0, Infinity], high: [-Infinity, 1.7, -Infinity] };
for (const { values } of motions) {
  values.forEach((value, i) => {
    bounds.low[i % 3] = Math.min(bounds.low[i % 3], value);
    bounds.high[i % 3] = Math.max(bounds.high[i % 3], value);
  });
}
const middle = motions.length === 0 ? [0, 0.9, 0] : mix(bounds.low, bounds.high, 0.5);
// A figure that walks far would be small in a view that stands still.
player.follow = motions.length > 0 && Math.max(bounds.high[0] - bounds.low[0], bounds.high[2] - bounds.low[2]) > 3;

/** Returns the point that the camera looks at. */
function focus(shown, time) {
  if (!player.follow || shown.length === 0) return middle;
  const places = shown.map((motion) => motion.along(time));
  const mean = (i) => places.reduce((sum, place) => sum + place[i], 0) / places.length;
  return [mean(0), middle[1], mean(1)];
}

/** Returns the motions of each view and its rectangle on the canvas. The number of columns is the one with the largest views. */
function views() {
  const { width, height } = canvas.getBoundingClientRect();
  if (player.overlay || motions.length < 2) return [{ shown: motions, cell: { x: 0, y: 0, width, height } }];
  let columns = 1;
  const size = (n) => Math.min(width / n / 0.8, height / Math.ceil(motions.length / n));
  for (let n = 2; n <= motions.length; n++) if (size(n) > size(columns)) columns = n;
  const rows = Math.ceil(motions.length / columns);
  return motions.map((motion, i) => {
    const inRow = Math.floor(i / columns) === rows - 1 ? motions.length - columns * (rows - 1) : columns;
    const cell = { width: width / inRow, height: height / rows };
    return { shown: [motion], cell: { ...cell, x: (i % columns) * cell.width, y: Math.floor(i / columns) * cell.height } };
  });
}

/** Returns the distance of the camera from which every view shows all of its motions. */
function fit(all) {
  const distances = all.map(({ shown, cell }) => {
    const points = [];
    for (let frame = 0; frame < frames; frame += 3) {
      const from = focus(shown, frame / data.rate);
      for (const motion of shown) for (const point of motion.pose(frame / data.rate)) points.push(sub(point, from));
    }
    return distanceToFit(points, cell);
  });
  return Math.max(1.5, ...distances);
}

/** Values that depend on sizes, colours and the selected views. They are computed again when one of these changes. */
let layout = null;
function arrange() {
  const ratio = Math.min(window.devicePixelRatio || 1, 3);
  const { width, height } = canvas.getBoundingClientRect();
  canvas.width = Math.max(Math.round(width * ratio), 1);
  canvas.height = Math.max(Math.round(height * ratio), 1);
  const style = getComputedStyle(document.documentElement);
  const variable = (name) => style.getPropertyValue(name).trim();
  const all = views();
  layout = {
    all,
    ratio,
    fit: fit(all),
    colours: motions.map((motion) => readable(motion.colour, darkness.matches)),
    appearance: { grid: variable("--grid"), line: variable("--line"), shadow: Number(variable("--shadow")) },
    choice: `${player.overlay} ${player.follow}`,
  };
  for (const chart of charts) chart.layout(darkness.matches);
  const labels = document.querySelectorAll("#figures li");
  motions.forEach((motion, i) => {
    const { cell } = player.overlay || motions.length < 2 ? { cell: { ...all[0].cell, y: 30 * i } } : all[i];
    labels[i].hidden = motion.label === "";
    labels[i].style.setProperty("--colour", css(layout.colours[i]));
    labels[i].style.transform = `translate(${cell.x}px, ${cell.y}px)`;
    labels[i].style.maxWidth = `${Math.max(cell.width - 20, 40)}px`;
  });
}

function draw3d() {
  const { all, ratio, appearance, colours } = layout;
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, canvas.width, canvas.height);
  for (const { shown, cell } of all) {
    lens = new Lens(camera, layout.fit, focus(shown, player.time), cell);
    const figures = shown.map((motion) => ({ motion, colour: colours[motions.indexOf(motion)] }));
    scene.draw(figures, player.time, lens, cell, { ...appearance, trails: player.trails });
    context.strokeStyle = appearance.line;
    context.lineWidth = 1;
    context.beginPath();
    if (cell.x > 0) context.rect(cell.x - 0.5, cell.y, 0, cell.height);
    if (cell.y > 0) context.rect(cell.x, cell.y - 0.5, cell.width, 0);
    context.stroke();
  }
  byId("scale").textContent = `squares of ${gridSide(lens)} m`;
  document.querySelectorAll("#figures li").forEach((label, i) => label.classList.toggle("over", player.time > motions[i].duration + 1e-6));
}

function redraw() {
  if (drawing === 0) drawing = requestAnimationFrame(tick);
}

function tick(moment) {
  drawing = 0;
  player.advance(lastMoment === 0 ? 0 : (moment - lastMoment) / 1000);
  lastMoment = player.playing ? moment : 0;
  if (!layout || layout.choice !== `${player.overlay} ${player.follow}` || layout.ratio !== Math.min(window.devicePixelRatio || 1, 3)) arrange();
  draw3d();
  for (const chart of charts) chart.show(player.time);
  showControls(player);
  if (player.playing) redraw();
}

function rearrange() {
  layout = null;
  redraw();
}

byId("scrub").max = String(frames - 1);
for (const id of ["back", "play", "forward", "scrub"]) byId(id).disabled = frames === 1;
byId("overlay").hidden = motions.length < 2;
byId("curves").hidden = charts.length === 0;
listenToPointers(canvas, camera, () => (lens ? lens.distance / lens.focal : 0.01), redraw);
listenToKeys(player, camera, redraw);
listenToButtons(player, camera, redraw);
const sizes = new ResizeObserver(rearrange);
sizes.observe(canvas);
for (const chart of charts) sizes.observe(chart.svg);
darkness.addEventListener("change", rearrange);

/**
 * The state of the player, for tests and for the console of the browser. Setting a property changes the state. Times are
 * in seconds, angles in radians, lengths in metres.
 */
window.lamogen = {
  get time() { return player.time; },
  set time(seconds) { player.seek(seconds); },
  get duration() { return player.duration; },
  /** The nearest frame, counted from 0. */
  get frame() { return player.frame; },
  get frames() { return frames; },
  get playing() { return player.playing; },
  set playing(plays) { if (plays) player.play(); else player.pause(); },
  get speed() { return player.speed; },
  set speed(times) { player.set("speed", times); },
  get loop() { return player.loop; },
  set loop(loops) { player.set("loop", loops); },
  get overlay() { return player.overlay; },
  set overlay(together) { player.set("overlay", together); },
  get follow() { return player.follow; },
  set follow(follows) { player.set("follow", follows); },
  get trails() { return player.trails; },
  set trails(shows) { player.set("trails", shows); },
  /** The camera of all views: azimuth, elevation, zoom, pan and distance. All but the distance may be set. */
  get camera() {
    const { azimuth, elevation, zoom, pan } = camera;
    return { azimuth, elevation, zoom, pan: [...pan], distance: (layout ? layout.fit : 0) / zoom };
  },
  set camera({ azimuth = camera.azimuth, elevation = camera.elevation, zoom = camera.zoom, pan = camera.pan }) {
    Object.assign(camera, { azimuth, elevation, zoom, pan });
    redraw();
  },
  /** For every motion: its label, its number of frames, and its pose (joints × 3) at a time. */
  motions: motions.map((motion) => ({ label: motion.label, frames: motion.frames, pose: (time) => motion.pose(time) })),
};

if (!matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
redraw();
