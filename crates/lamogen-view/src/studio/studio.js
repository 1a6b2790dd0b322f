// The program of the studio: it connects fields, sliders, requests, player and history.

/** Steps of a coarse motion, which is shown while one drags. */
const COARSE_STEPS = 6;
/** The time that a slider has to rest until its motion is made with all steps, before it is released, in milliseconds. */
const RESTING_PAUSE = 180;
/** The time after the last letter of a sentence until its motion is asked for, in milliseconds. */
const TYPING_PAUSE = 450;
const GREY = [107, 114, 128];
const RED = [194, 65, 12];
const BLUE = [3, 105, 161];

const darkness = matchMedia("(prefers-color-scheme: dark)");

/** Returns the token in the address, and takes it out of there: it stays in this tab. */
function takeToken() {
  const fields = new URLSearchParams(location.hash.slice(1));
  const given = fields.get("token");
  if (given !== null) {
    sessionStorage.setItem("lamogen-token", given);
    fields.delete("token");
    history.replaceState(null, "", fields.size ? `#${fields}` : location.pathname);
  }
  return sessionStorage.getItem("lamogen-token");
}

const server = new Server(takeToken());

/** Asks for the model until the server answers. */
async function describeModel() {
  for (;;) {
    try {
      return await (await server.ask("api/v1/model")).json();
    } catch (error) {
      say(error instanceof Refusal ? error.message : "The server does not answer. Trying again …");
      if (error instanceof Refusal && !error.retryAfter) throw error;
      await new Promise((later) => setTimeout(later, 1000 * RETRY_SECONDS));
    }
  }
}

/** Says something in the line under the title. */
function say(text) {
  byId("status").textContent = text;
}

/** Says what is wrong in the place where it is: the field that the problem names, or above the fields. */
function showProblem(place, text) {
  const places = { prompt: "prompt-problem", seconds: "seconds-problem", seed: "seed-problem", part: "part-problem", path: "path-problem", face: "path-problem", reach: "reach-problem", file: "file-problem", keep: "keep-problem" };
  for (const id of Object.values(places)) byId(id).hidden = true;
  for (const id of ["prompt", "seconds", "seed"]) byId(id).removeAttribute("aria-invalid");
  byId("problem").hidden = true;
  if (!text) return;
  const line = byId(places[place] ?? "problem");
  line.textContent = text;
  line.hidden = false;
  if (["prompt", "seconds", "seed"].includes(place)) byId(place).setAttribute("aria-invalid", "true");
}

async function start() {
  const model = await describeModel();
  const { components, joints, frames_per_second: rate } = model;
  const index = Object.fromEntries(joints.map((name, joint) => [name, joint]));
  const shortest = model.frames[0] / rate;

  let wish = fromFragment(location.hash, components);
  let scene = null;
  let shownCoarsely = false;
  /** The file that was dropped: { name, report, motion }. */
  let dropped = null;
  /** The character that was dropped: { name, file, answer, isShown }. */
  let character = null;
  let compares = true;
  let drawing = 0;
  let lastMoment = 0;
  let charts = [];
  /** For tests: what happened to each request. */
  const log = [];

  const player = new Player(Math.round(totalSeconds(wish) * rate), rate, () => redraw());
  const canvas = byId("view");
  const stage = new SteadyStage(canvas, byId("figures"), index, player);
  const { camera } = stage;
  const painter = new CharacterPainter(byId("bodies"), () => redraw());
  stage.showOn(painter);
  stage.show([]);

  function redraw() {
    if (drawing === 0) drawing = requestAnimationFrame(tick);
  }

  function tick(moment) {
    drawing = 0;
    player.advance(lastMoment === 0 ? 0 : (moment - lastMoment) / 1000);
    lastMoment = player.playing ? moment : 0;
    if (stage.arrange(darkness.matches)) {
      for (const chart of charts) chart.layout(darkness.matches);
    }
    stage.draw();
    for (const chart of charts) chart.show(player.time);
    timeline.showTime(player.time - segments.start);
    segments.showTime(player.time);
    floor.showTime(player.time);
    showControls(player);
    byId("compare").setAttribute("aria-pressed", String(compares));
    if (player.playing) redraw();
  }

  function rearrange() {
    stage.layout = null;
    timeline.show(segments.sentence);
    floor.show(wish);
    redraw();
  }

  /** The name under which the server keeps the character that is shown, or null. */
  const onto = () => (character?.isShown ? character.answer.onto : null);

  const toMotion = ({ joints: poses }, label, colour) => new Motion({ label, colour, values: Float64Array.from(poses.flat(2)) }, joints.length, rate);

  /** Returns the figures and curves of what is shown. */
  function figures() {
    const motions = [];
    const curves = [];
    const curve = (label, colour, series, dashed = false) => curves.push({ label, colour, dashed, series });
    if (scene) {
      const isGuided = scene.motions.length > 1;
      const main = scene.motions[scene.motions.length - 1];
      const add = (motion, label, colour, isGrey) => {
        const figure = toMotion(motion, label, colour);
        if (motion.character && onto() !== null && scene.onto === onto()) Object.assign(figure, { bones: new BoneTrack(motion.character), isGrey });
        motions.push(figure);
      };
      if (isGuided && compares) add(scene.motions[0], "text alone", GREY, true);
      add(main, isGuided ? "guided" : "text alone", isGuided ? RED : GREY, false);
      if (isGuided) {
        curve("text alone", GREY, scene.motions[0].series);
        // Of components that may become anything there is no target.
        if (scene.target) curve("asked", RED, scene.target.series, true);
      }
      curve(isGuided ? "guided" : "text alone", isGuided ? RED : GREY, main.series);
    }
    if (dropped) {
      motions.push(dropped.motion);
      curve(dropped.name, BLUE, dropped.report.motions[0].series);
    }
    return { motions, curves };
  }

  /** Puts the motions and curves on the page. The time goes on where it was. */
  function show() {
    const { motions, curves } = figures();
    byId("figures").replaceChildren();
    for (const motion of motions) append(append(byId("figures"), "li"), "bdi", "", motion.label);
    player.frames = Math.max(1, ...motions.map((motion) => motion.frames));
    player.time = Math.min(player.time, player.duration);
    stage.show(motions);
    byId("charts").replaceChildren();
    const borders = (scene?.sentences ?? []).slice(1).map(({ from }) => from);
    charts = components.map((component) => {
      const [less, more] = component.words.map(({ word }) => word);
      const lines = curves.filter(({ series }) => series[component.key]).map(({ series, ...rest }) => ({ ...rest, values: series[component.key] }));
      return new Chart(byId("charts"), { ...component, less, more }, lines, rate, player.duration, (time) => player.goTo(time * rate), borders);
    });
    byId("scrub").max = String(player.frames - 1);
    for (const id of ["back", "play", "forward", "scrub"]) byId(id).disabled = player.frames === 1;
    byId("compare").hidden = !scene || scene.motions.length < 2;
    byId("overlay").hidden = motions.length < 2;
    redraw();
  }

  /** Shows the words of the model about the sentence. */
  function showNotes() {
    const { unseen_words: unseen = [], stand_in: standIn, cut_tokens: cut } = scene;
    const notes = [];
    if (standIn) notes.push(`The model knows no word of this that says how to move: the motion is that of “${standIn}”.`);
    else if (unseen.length) notes.push(`The model has not met: ${unseen.join(", ")}. The motion goes by the other words.`);
    if (cut) notes.push(`The sentence is too long: its last ${cut} tokens are left out.`);
    byId("prompt-note").textContent = notes.join(" ");
    byId("prompt-note").hidden = notes.length === 0;
  }

  const past = new History(byId("history"), byId("undo"), (old) => describeWish(old, components), (entry) => {
    requests.stop();
    wish = copyWish(entry.wish);
    scene = entry.scene;
    shownCoarsely = false;
    showWish();
    showScene();
    showProblem(null, "");
    say("");
    remember();
    // A motion that was made before the character came.
    if (onto() !== null && scene.onto !== onto()) ask();
  });

  const requests = new Requests(server, {
    shown(result, request) {
      const isFirst = scene === null;
      scene = result;
      shownCoarsely = request.isCoarse;
      if (character && scene.onto === character.answer.onto) character.isSentAgain = false;
      showProblem(null, "");
      showScene();
      if (isFirst && !matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
      if (isFirst) player.follow = stage.travels;
      log.push({ number: request.number, coarse: request.isCoarse, milliseconds: performance.now() - request.asked });
      if (request.isCoarse) return;
      const seconds = (performance.now() - request.asked) / 1000;
      say(`In place after ${seconds.toFixed(1)} s.`);
      remember();
      if (isSame(past.shown?.wish, request.source)) {
        past.shown.scene = scene;
        return;
      }
      const main = scene.motions[scene.motions.length - 1];
      const picture = thumbnail(toMotion(main, "", RED), index, darkness.matches);
      past.add({ wish: copyWish(request.source), scene, picture });
    },
    failed(error, request, isGone) {
      if (isGone) say("The server does not answer. Trying again …");
      else if (error.retryAfter) say(`The server is busy. Trying again in ${error.retryAfter} s …`);
      else if (error.problem.where === "onto" && character?.isShown && !character.isSentAgain) {
        // The server has forgotten the character: it was started again, or others came.
        character.isSentAgain = true;
        sendCharacter(character.file, true).catch((failure) => showProblem("file", failure.message));
      } else {
        showProblem(error.problem.where, error.message);
        say("");
      }
    },
    busy(share) {
      byId("progress").hidden = share === null;
      if (share !== null) byId("progress").value = share;
      document.body.classList.toggle("busy", share !== null);
    },
  });

  function showScene() {
    show();
    showNotes();
    showNumbers();
    const main = scene.motions[scene.motions.length - 1];
    floor.showResult(main.joints.map(([[x, , z]]) => [x, z]), scene.places ?? []);
    reaches.showResult(scene.places ?? []);
  }

  /** Shows at the sliders what was asked of the chosen sentence and what came out. */
  function showNumbers() {
    if (!scene) return;
    const span = scene.sentences?.[segments.place];
    // An older motion may have another number of sentences.
    if ((scene.sentences?.length ?? 1) !== wish.sentences.length) sliders.showResult(null);
    else sliders.showResult(scene, span ? [span.from, span.until].map((time) => Math.round(time * rate)) : null);
  }

  /** Keeps the wish in the address. */
  function remember() {
    history.replaceState(null, "", toFragment(wish, components));
  }

  let resting = 0;
  /** Asks for the motion of the wish. */
  function ask(isCoarse = false, isPatient = false) {
    const request = toRequest(wish, components);
    if (onto() !== null) request.onto = onto();
    clearTimeout(resting);
    if (isCoarse) resting = setTimeout(() => ask(false, true), RESTING_PAUSE);
    const wordless = wish.sentences.findIndex(({ prompt }) => prompt.trim() === "");
    if (wordless >= 0) {
      requests.stop();
      const which = wish.sentences.length > 1 ? ` in sentence ${wordless + 1}` : "";
      showProblem(wordless === segments.place ? "prompt" : null, `Write what the person does${which}, such as “a person jumps”.`);
      return;
    }
    // A motion that was asked for while the slider rested is there already when it is released.
    if (!isCoarse && !shownCoarsely && isSame(past.shown?.wish, wish) && (onto() === null || scene?.onto === onto())) {
      requests.stop();
      requests.busy(null);
      return;
    }
    // While one drags, only what the slider changes has to be seen: fewer steps, and the network's own body.
    const asked = isCoarse ? { ...request, steps: COARSE_STEPS, body: "network" } : request;
    requests.ask(asked, { isCoarse, isPatient, source: copyWish(wish) });
  }

  const sliders = new FactorSliders(byId("factors"), components, (c, factor, isReleased) => {
    segments.sentence.factors[c] = factor;
    timeline.show(segments.sentence);
    ask(!isReleased);
  });
  const parts = new PartSliders({ pick: byId("part-add"), list: byId("part-list") }, components, {
    moved(p, c, factor, isReleased) {
      segments.sentence.parts[p].factors[c] = factor;
      ask(!isReleased);
    },
    added(part) {
      segments.sentence.parts.push({ part, factors: [1, 1, 1] });
      parts.show(segments.sentence);
    },
    removed(p) {
      const [{ factors }] = segments.sentence.parts.splice(p, 1);
      parts.show(segments.sentence);
      if (factors.some((factor) => factor !== 1)) ask();
    },
  });
  const timeline = new Timeline(
    {
      lanes: byId("lanes"), lane: byId("lane"), slides: byId("slides"),
      add: byId("key-add"), remove: byId("key-remove"), clear: byId("keys-clear"),
      time: () => player.time - segments.start,
    },
    components,
    (isReleased) => {
      sliders.show(segments.sentence);
      ask(!isReleased);
    },
  );
  const segments = new Segments(
    {
      track: byId("segments"), add: byId("segment-add"), title: byId("segment-title"),
      remove: byId("segment-remove"), earlier: byId("segment-earlier"), later: byId("segment-later"),
      time: () => player.time,
    },
    components,
    shortest,
    {
      chosen(i) {
        showWish();
        showNumbers();
        const [from, until] = [segments.start, segments.start + segments.sentence.seconds];
        if (player.time < from || player.time >= until) player.seek(from);
      },
      changed(isReleased) {
        showWish();
        ask(!isReleased);
      },
      added() {
        byId("prompt").focus();
        byId("prompt").select();
      },
    },
  );
  const floor = new Floor(
    {
      map: byId("floor"), list: byId("place-list"), note: byId("floor-note"), add: byId("place-add"), clear: byId("places-clear"),
      facing: byId("facing"), face: byId("face"), degrees: byId("face-degrees"),
      time: () => player.time,
    },
    {
      moved(isReleased) {
        showLoop();
        ask(!isReleased);
        stage.scene.places = wish.path;
        redraw();
      },
    },
  );
  byId("places").addEventListener("toggle", () => floor.show(wish));
  const reaches = new Reaches(
    { view: byId("stage"), pick: byId("reach-add"), list: byId("reach-list"), note: byId("reach-note"), clear: byId("reaches-clear") },
    stage,
    {
      time: () => player.time,
      where: (joint, time) => scene?.motions.at(-1).joints[Math.min(Math.round(time * rate), scene.motions.at(-1).joints.length - 1)]?.[index[joint]],
      moved(isReleased) {
        ask(!isReleased);
        redraw();
      },
      turned: () => redraw(),
    },
  );

  /** Shows whether the motion is a loop, and why it cannot be one. */
  function showLoop() {
    byId("cycle").checked = wish.loop;
    byId("cycle").disabled = !canLoop(wish);
    byId("cycle").parentElement.title = wish.sentences.length > 1 ? "Several sentences make no loop" : wish.path.length > 0 ? "A path makes no loop" : "";
  }

  /** Shows the wish in all fields. */
  function showWish() {
    segments.show(wish);
    const { sentence } = segments;
    byId("prompt").value = sentence.prompt;
    byId("seconds").value = String(number(sentence.seconds));
    byId("seed").value = String(wish.seed);
    showLoop();
    sliders.show(sentence);
    parts.show(sentence);
    if (sentence.parts.length) byId("parts").open = true;
    timeline.show(sentence);
    byId("timeline-title").textContent = wish.sentences.length > 1 ? `Over time, sentence ${segments.place + 1}` : "Over time";
    if (wish.path.length) byId("places").open = true;
    stage.scene.places = wish.path;
    floor.show(wish);
    if (wish.reaches.length) byId("reaches").open = true;
    reaches.show(wish);
    showDropped();
  }

  let typing = 0;
  byId("prompt").addEventListener("input", () => {
    segments.sentence.prompt = byId("prompt").value;
    segments.show(wish);
    clearTimeout(typing);
    typing = setTimeout(() => {
      typing = 0;
      ask();
    }, TYPING_PAUSE);
  });
  byId("prompt").addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || event.shiftKey) return;
    event.preventDefault();
    clearTimeout(typing);
    typing = 0;
    ask();
  });
  byId("panel").addEventListener("submit", (event) => event.preventDefault());
  Object.assign(byId("seconds"), { min: shortest, max: LONGEST_SENTENCE });
  byId("seconds").addEventListener("change", () => {
    const seconds = Number(byId("seconds").value);
    if (!(seconds >= shortest && seconds <= LONGEST_SENTENCE)) {
      showProblem("seconds", `Expected ${shortest} to ${LONGEST_SENTENCE} seconds, found ${byId("seconds").value || "nothing"}.`);
      return;
    }
    segments.resize(segments.place, seconds, true);
  });
  byId("seed").addEventListener("change", () => {
    const text = byId("seed").value;
    const seed = Number(text);
    if (text === "" || !Number.isSafeInteger(seed) || seed < 0) {
      showProblem("seed", `Expected a whole number from 0, found ${text || "nothing"}.`);
      return;
    }
    wish.seed = seed;
    ask();
  });
  function rollDice() {
    wish.seed = crypto.getRandomValues(new Uint32Array(1))[0] % 1_000_000;
    showWish();
    ask();
  }
  byId("dice").addEventListener("click", rollDice);
  byId("cycle").addEventListener("change", () => {
    wish.loop = byId("cycle").checked;
    ask();
  });

  function toggleCompare() {
    compares = !compares;
    if (scene) show();
  }
  byId("compare").addEventListener("click", toggleCompare);
  byId("link").addEventListener("click", async () => {
    remember();
    try {
      await navigator.clipboard.writeText(location.href);
      say("The link is copied.");
    } catch {
      say("The link is in the address bar of the browser.");
    }
  });

  // Files.
  function showDropped() {
    if (!dropped) {
      byId("report").hidden = true;
      return;
    }
    const { name, report } = dropped;
    const isLiked = wish.like !== null && wish.like.name === name;
    showReport(byId("report"), { name, report, isLiked }, components, {
      use() {
        wish.like = isLiked ? null : { name, series: report.motions[0].series };
        showWish();
        ask();
      },
      remove() {
        const wasLiked = wish.like !== null;
        dropped = null;
        wish.like = null;
        showWish();
        show();
        if (wasLiked) ask();
      },
    });
  }
  const upload = async (path, file, options) => {
    const query = new URLSearchParams({ name: file.name, ...options });
    const answer = await server.ask(`${path}?${query}`, { body: file, type: "application/octet-stream" });
    return answer.json();
  };
  function showCharacterSection() {
    byId("character").hidden = character === null;
    if (character === null) return;
    showCharacter(byId("character"), character, painter.gl !== null, {
      toggle() {
        character.isShown = !character.isShown;
        showCharacterSection();
        show();
        ask();
      },
      remove() {
        character = null;
        painter.load(null);
        showCharacterSection();
        show();
      },
    });
  }
  /** Sends a character to the server, and shows the motion on it if `isShown`. */
  async function sendCharacter(file, isShown) {
    const answer = await upload("api/v1/character", file);
    character = { name: file.name, file, answer, isShown, isSentAgain: character?.isSentAgain && character.file === file };
    painter.load(answer.mesh);
    showCharacterSection();
    show();
    ask();
  }
  listenToFiles(byId("file"), byId("drop-here"), async (file) => {
    showProblem(null, "");
    say(`Reading ${file.name} …`);
    const failures = [];
    const isCharacter = /\.(glb|vrm)$/i.test(file.name);
    let isMotion = false;
    try {
      const report = await upload("api/v1/laban", file, { joints: "true" });
      isMotion = true;
      dropped = { name: file.name, report, motion: toMotion(report.motions[0], file.name, BLUE) };
      showDropped();
      show();
    } catch (error) {
      failures.push(error);
    }
    // A file may be both: the motion of a character. Then it is a motion until somebody says otherwise.
    try {
      if (isCharacter) await sendCharacter(file, !isMotion);
    } catch (error) {
      failures.push(error);
    }
    say("");
    if (failures.length < (isCharacter ? 2 : 1)) return;
    const error = failures[/\.vrm$/i.test(file.name) ? 1 : 0];
    showProblem("file", error instanceof Refusal ? error.message : `${file.name}: the server does not answer`);
  });
  for (const [name, ending, mediaType, purpose] of EXPORTS) {
    const button = append(byId("exports"), "button", "", name);
    button.type = "button";
    button.title = purpose;
    button.setAttribute("aria-label", `${name}: ${purpose}`);
    button.addEventListener("click", async () => {
      showProblem(null, "");
      button.disabled = true;
      say(`Writing ${name} …`);
      try {
        const isOnto = ending === "glb" && onto() !== null;
        const write = () => {
          const request = { ...toRequest(wish, components), ...(isOnto ? { onto: onto() } : {}) };
          return server.ask("api/v1/generate", { accept: mediaType, body: JSON.stringify(request), type: "application/json" });
        };
        let answer;
        try {
          answer = await write();
        } catch (error) {
          if (!isOnto || error.problem?.where !== "onto") throw error;
          // The server has forgotten the character.
          await sendCharacter(character.file, true);
          answer = await write();
        }
        const stem = fileStem(wish.sentences[0].prompt);
        if (isOnto) save(await answer.blob(), `${stem}-on-${character.name}`);
        else save(await answer.blob(), `${stem}.${ending}`);
        say("");
      } catch (error) {
        say("");
        showProblem("keep", error instanceof Refusal ? error.message : "The server does not answer.");
      } finally {
        button.disabled = false;
      }
    });
  }

  listenToPointers(canvas, camera, () => stage.pixel, redraw);
  listenToKeys(player, camera, redraw, { n: rollDice, c: toggleCompare });
  listenToButtons(player, camera, redraw);
  document.addEventListener("keydown", (event) => {
    const isTyping = document.activeElement.matches("textarea, input[type=number]");
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !isTyping) {
      event.preventDefault();
      past.back();
    }
  });
  const sizes = new ResizeObserver(rearrange);
  for (const id of ["view", "charts", "lane", "floor"]) sizes.observe(byId(id));
  darkness.addEventListener("change", rearrange);
  window.addEventListener("hashchange", () => {
    wish = fromFragment(location.hash, components);
    showWish();
    ask();
  });

  /** The state of the studio, for tests and for the console of the browser. */
  window.studio = {
    get wish() { return copyWish(wish); },
    /** The chosen sentence, and its place among the others. */
    get sentence() { return structuredClone(segments.sentence); },
    get chosen() { return segments.place; },
    get scene() { return scene; },
    /** Whether the shown motion is a coarse one. */
    get coarse() { return shownCoarsely; },
    /** Whether a motion is being made, or will be as soon as typing pauses. */
    get busy() { return requests.current !== null || typing !== 0; },
    /** Every answer that was shown: number, whether it was coarse, milliseconds from the request. */
    get log() { return log; },
    get history() { return past.entries.length; },
    get dropped() { return dropped; },
    /** The character: its name, whether the motion is put on it, and whether it is drawn. */
    get character() { return character && { name: character.name, onto: character.answer.onto, isShown: character.isShown, isDrawn: character.isShown && painter.isReady }; },
    painter,
    player,
    stage,
    floor,
    reaches,
    get request() { return toRequest(wish, components); },
  };
  say("");
  showWish();
  show();
  ask();
}

start().catch((error) => {
  showProblem(null, error.message);
  say("The studio could not start.");
});
