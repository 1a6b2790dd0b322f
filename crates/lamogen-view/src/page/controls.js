// Input from mouse, touch, keys and buttons.

const byId = (id) => document.getElementById(id);

/** Drags and pinches on the canvas turn, move and zoom the camera. `metres` returns the size of a pixel in metres. */
function listenToPointers(canvas, camera, metres, changed) {
  const held = new Map();
  const RADIANS = 0.0085;
  canvas.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    canvas.setPointerCapture(event.pointerId);
    const moves = event.button === 2 || event.button === 1 || event.shiftKey;
    held.set(event.pointerId, { x: event.clientX, y: event.clientY, moves });
    canvas.classList.add("held");
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const after = { ...before, x: event.clientX, y: event.clientY };
    const other = [...held].find(([id]) => id !== event.pointerId)?.[1];
    held.set(event.pointerId, after);
    const [right, down] = [after.x - before.x, after.y - before.y];
    if (other) {
      // Each of two fingers moves the point between them by half of its own movement.
      const apart = (finger) => Math.max(Math.hypot(finger.x - other.x, finger.y - other.y), 8);
      camera.closer(apart(after) / apart(before));
      camera.shift((-right / 2) * metres(), (down / 2) * metres());
    } else if (before.moves) {
      camera.shift(-right * metres(), down * metres());
    } else {
      camera.turn(right * RADIANS, down * RADIANS);
    }
    changed();
  });
  const release = (event) => {
    held.delete(event.pointerId);
    if (held.size === 0) canvas.classList.remove("held");
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1);
      // Browsers report a pinch on a touch pad as a small wheel event with Ctrl.
      camera.closer(Math.exp(-Math.min(Math.max(pixels, -300), 300) * (event.ctrlKey ? 0.01 : 0.0015)));
      changed();
    },
    { passive: false },
  );
}

/** Keys work everywhere on the page, unless the focused element uses them itself. `more` are further keys with their actions. */
function listenToKeys(player, camera, changed, more = {}) {
  const TURN = 0.12;
  const view = (action) => {
    action();
    changed();
  };
  const turns = {
    ArrowLeft: () => view(() => camera.turn(-TURN, 0)),
    ArrowRight: () => view(() => camera.turn(TURN, 0)),
    ArrowUp: () => view(() => camera.turn(0, TURN)),
    ArrowDown: () => view(() => camera.turn(0, -TURN)),
  };
  const keys = {
    " ": () => player.toggle(),
    ArrowLeft: () => player.step(-1),
    ArrowRight: () => player.step(1),
    Home: () => player.goTo(0),
    End: () => player.goTo(player.frames - 1),
    ",": () => player.faster(-1),
    "<": () => player.faster(-1),
    ".": () => player.faster(1),
    ">": () => player.faster(1),
    "+": () => view(() => camera.closer(1.15)),
    "=": () => view(() => camera.closer(1.15)),
    "-": () => view(() => camera.closer(1 / 1.15)),
    0: () => view(() => camera.reset()),
    r: () => view(() => camera.reset()),
    w: () => view(() => camera.shift(0, 0.1)),
    s: () => view(() => camera.shift(0, -0.1)),
    a: () => view(() => camera.shift(-0.1, 0)),
    d: () => view(() => camera.shift(0.1, 0)),
    l: () => player.set("loop", !player.loop),
    o: () => player.set("overlay", !player.overlay),
    f: () => player.set("follow", !player.follow),
    t: () => player.set("trails", !player.trails),
    "?": () => byId("help").showModal(),
    ...more,
  };
  const MOVES = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"];
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || byId("help").open) return;
    const focused = document.activeElement;
    if (focused.matches("select") && event.key !== "?") return;
    if (event.key === " " && focused.matches("button, summary, input[type=checkbox]")) return;
    if (focused.matches("textarea, input[type=number]")) return;
    if (MOVES.includes(event.key) && focused.matches("input[type=range]:not(#scrub), [role=slider]")) return;
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const action = (event.shiftKey && turns[name]) || keys[name];
    if (!action) return;
    event.preventDefault();
    action();
  });
}

/** Handles the buttons, the time bar and the list of speeds. */
function listenToButtons(player, camera, changed) {
  const on = (id, action) =>
    byId(id).addEventListener("click", (event) => {
      action();
      changed();
      // After a click with the mouse, the space bar must again play and pause.
      if (event.detail > 0) byId(id).blur();
    });
  on("play", () => player.toggle());
  on("back", () => player.step(-1));
  on("forward", () => player.step(1));
  on("zoom-in", () => camera.closer(1.25));
  on("zoom-out", () => camera.closer(1 / 1.25));
  on("reset", () => camera.reset());
  on("help-open", () => byId("help").showModal());
  for (const name of ["loop", "overlay", "follow", "trails"]) on(name, () => player.set(name, !player[name]));
  byId("scrub").addEventListener("input", (event) => player.goTo(Number(event.target.value)));
  byId("speed").addEventListener("change", (event) => {
    player.set("speed", Number(event.target.value));
    event.target.blur();
  });
}

/** Shows the state of the player on buttons, time bar and read-out. */
function showControls(player) {
  const { frame, frames, time, duration } = player;
  byId("play").classList.toggle("playing", player.playing);
  byId("play").setAttribute("aria-label", player.playing ? "Pause" : "Play");
  byId("speed").value = String(player.speed);
  for (const name of ["loop", "overlay", "follow", "trails"]) byId(name).setAttribute("aria-pressed", String(player[name]));
  const scrub = byId("scrub");
  scrub.value = String(frame);
  scrub.style.setProperty("--done", `${duration > 0 ? (100 * time) / duration : 0}%`);
  scrub.setAttribute("aria-valuetext", `${time.toFixed(2)} of ${duration.toFixed(2)} seconds, frame ${frame + 1} of ${frames}`);
  const now = document.createElement("b");
  now.textContent = time.toFixed(2);
  const place = document.createElement("span");
  place.textContent = `frame ${frame + 1} of ${frames}`;
  byId("read-out").replaceChildren(now, ` / ${duration.toFixed(2)} s `, place);
}
