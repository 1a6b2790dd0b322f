// The program of the page: it connects data, scene, charts and controls.

const data = JSON.parse(byId("data").textContent);
const index = Object.fromEntries(data.joints.map((name, joint) => [name, joint]));
const motions = data.motions.map((encoded) => decodeMotion(encoded, data.joints.length, data.rate));
const curves = data.curves.map((curve) => ({ ...curve, values: decodeFloats(curve.values) }));
const components = data.components.length;
const frames = Math.max(1, ...motions.map((motion) => motion.frames), ...curves.map((curve) => curve.values.length / components));

const darkness = matchMedia("(prefers-color-scheme: dark)");
let drawing = 0;
let lastMoment = 0;

const player = new Player(frames, data.rate, () => redraw());
/** The moments at which one caption follows another, in seconds. */
const borders = data.captions.slice(1).map(({ from }) => from / data.rate);
const charts = curves.length === 0 ? [] : data.components.map((component, c) => {
  const lines = curves.map((curve) => ({ ...curve, values: Array.from(curve.values.filter((_, i) => i % components === c)) }));
  return new Chart(byId("charts"), component, lines, data.rate, player.duration, (time) => player.goTo(time * data.rate), borders);
});

const captions = new Captions({ list: byId("captions"), line: byId("caption") }, data.captions, (frame) => player.goTo(frame));

const canvas = byId("view");
const stage = new Stage(canvas, byId("figures"), index, player);
const { camera } = stage;
stage.show(motions);
player.follow = stage.travels;

function redraw() {
  if (drawing === 0) drawing = requestAnimationFrame(tick);
}

function tick(moment) {
  drawing = 0;
  player.advance(lastMoment === 0 ? 0 : (moment - lastMoment) / 1000);
  lastMoment = player.playing ? moment : 0;
  if (stage.arrange(darkness.matches)) for (const chart of charts) chart.layout(darkness.matches);
  stage.draw();
  for (const chart of charts) chart.show(player.time);
  captions.show(player.frame);
  showControls(player);
  if (player.playing) redraw();
}

function rearrange() {
  stage.layout = null;
  redraw();
}

byId("scrub").max = String(frames - 1);
for (const id of ["back", "play", "forward", "scrub"]) byId(id).disabled = frames === 1;
byId("overlay").hidden = motions.length < 2;
byId("curves").hidden = charts.length === 0;
listenToPointers(canvas, camera, () => stage.pixel, redraw);
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
    return { azimuth, elevation, zoom, pan: [...pan], distance: (stage.layout ? stage.layout.fit : 0) / zoom };
  },
  set camera({ azimuth = camera.azimuth, elevation = camera.elevation, zoom = camera.zoom, pan = camera.pan }) {
    Object.assign(camera, { azimuth, elevation, zoom, pan });
    redraw();
  },
  /** What is said at the time, or null. */
  get caption() { return data.captions[captions.at(player.frame)]?.text ?? null; },
  /** For every motion: its label, its number of frames, and its pose (joints × 3) at a time. */
  motions: motions.map((motion) => ({ label: motion.label, frames: motion.frames, pose: (time) => motion.pose(time) })),
};

if (!matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
redraw();
