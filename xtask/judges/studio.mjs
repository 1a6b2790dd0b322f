// Uses the studio in a real browser as people do, says what does not work, and how long the motion takes to follow.
//
//   npm install && node studio.mjs LAMOGEN BVH VRM [FOLDER-FOR-SCREENSHOTS]
//
// LAMOGEN is the command; BVH is a motion file to drop, VRM a character. The browser is /usr/bin/chromium, or the one that CHROMIUM names. Exit
// code 1 if anything failed.

import { spawn } from "node:child_process";
import { mkdirSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { cpus, loadavg, tmpdir } from "node:os";
import { basename, join } from "node:path";
import { check, finish, openBrowser, openPage, visit } from "./browser.mjs";

const [command, bvh, vrm, folder] = process.argv.slice(2);
if (!vrm) {
  console.error("usage: node studio.mjs LAMOGEN BVH VRM [FOLDER-FOR-SCREENSHOTS]");
  process.exit(2);
}
if (folder) mkdirSync(folder, { recursive: true });

/** Starts the studio on a port; 0 is any free one. Returns its address and how to end it. */
function startStudio(port = 0) {
  const child = spawn(command, ["studio", "--no-open", "--port", String(port), "--json"], { stdio: ["ignore", "pipe", "inherit"] });
  const ended = new Promise((end) => child.on("exit", (code) => end(code)));
  return new Promise((started, failed) => {
    child.on("error", failed);
    child.stdout.once("data", (text) => {
      const { address } = JSON.parse(text);
      started({ address, child, end: () => (child.kill("SIGTERM"), ended) });
    });
    ended.then((code) => failed(new Error(`the studio ended with ${code}`)));
  });
}

/** Opens the studio with a fragment in a fresh browser and hands it to `use`; whatever it loads from elsewhere or complains of is a failure. */
const visitStudio = (name, fragment, options, use) =>
  visit(name, async () => {
    // A visit that ended too early may have left the studio ended.
    if (studio.child.exitCode !== null || studio.child.signalCode !== null) studio = await startStudio(new URL(studio.address).port);
    const context = await openBrowser({ reducedMotion: "reduce", acceptDownloads: true, ...options }, ["--disable-gpu", "--enable-unsafe-swiftshader"]);
    try {
      const { page, complaints, loaded } = await openPage(context);
      await page.goto(studio.address + fragment);
      await settled(page);
      await use(page, context, complaints);
      // A server that is away on purpose is the browser's to complain of.
      const unexpected = complaints.filter((text) => !text.includes("ERR_CONNECTION_REFUSED") && !text.includes("GL Driver Message") && !text.includes("status of 4"));
      check(unexpected.length === 0, `${name}: the console is silent`, unexpected);
      const origin = new URL(studio.address).origin;
      const others = loaded.filter((url) => !url.startsWith(`${origin}/`) && !url.startsWith("data:") && !url.startsWith("blob:"));
      check(others.length === 0, `${name}: nothing comes from elsewhere`, others);
    } finally {
      await context.close();
    }
  });

/** Waits until a full motion is in place and nothing goes on. */
async function settled(page) {
  await page.waitForFunction(() => window.studio && window.studio.scene && !window.studio.busy && !window.studio.coarse, null, { timeout: 60_000 });
  await page.evaluate(() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn))));
}

/** Opens a link, by default the address of the page, as if it had come from elsewhere. */
async function openLink(page, link = page.url()) {
  await page.goto("about:blank");
  await page.goto(link);
  await settled(page);
}

const state = (page) =>
  page.evaluate(() => {
    const { wish, sentence, chosen, scene, log, history, request } = window.studio;
    const means = Object.fromEntries(Object.entries(scene.motions.at(-1).laban).map(([key, { mean }]) => [key, mean]));
    return { wish, sentence, chosen, means, motions: scene.motions.length, goals: scene.goals, log: log.slice(), history, request, labels: [...document.querySelectorAll("#figures li")].map((label) => label.textContent), status: document.getElementById("status").textContent };
  });

async function picture(page, name) {
  await page.evaluate(() => { window.studio.player.pause(); window.studio.player.seek(window.studio.player.duration * 0.55); });
  await page.waitForTimeout(150);
  if (folder) await page.screenshot({ path: join(folder, `${name}.png`) });
}

/** Drags a slider from where it is to a factor, in so many moves, and holds it until `seen` says so. */
async function dragSlider(page, id, to, moves = 12, pause = 60, seen = () => true) {
  const slider = page.locator(`#${id}`);
  await slider.scrollIntoViewIfNeeded();
  const box = await slider.boundingBox();
  const from = Number(await slider.inputValue());
  // The middle of the knob goes from 11 pixels after the beginning to 11 before the end.
  const at = (factor) => box.x + 11 + ((factor - 0.2) / 1.8) * (box.width - 22);
  const y = box.y + box.height / 2;
  await page.mouse.move(at(from), y);
  await page.mouse.down();
  for (let i = 1; i <= moves; i++) {
    await page.mouse.move(at(from + ((to - from) * i) / moves), y);
    await page.waitForTimeout(pause);
  }
  for (let i = 0; i < 400 && !(await seen()); i++) {
    await page.mouse.move(at(to - (i % 2 ? 0 : 0.1)), y);
    await page.waitForTimeout(pause);
  }
  await page.mouse.move(at(to), y);
  await page.mouse.up();
}

async function noOverflow(page, name) {
  const wide = await page.evaluate(() => [document.documentElement.scrollWidth, window.innerWidth]);
  check(wide[0] <= wide[1], `${name}: nothing is wider than the screen`, wide);
}

const median = (numbers) => [...numbers].sort((a, b) => a - b)[Math.floor(numbers.length / 2)];

/** Everything of the page that has no name for those who do not see it. */
const nameless = (page) =>
  page.evaluate(() =>
    [...document.querySelectorAll("button, input, select, textarea, canvas, [role=slider]")]
      .filter((element) => element.getAttribute("aria-hidden") !== "true" && !(element.getAttribute("aria-label") || element.labels?.length || element.textContent.trim()))
      .map((element) => element.outerHTML));

/** The folder of what is downloaded. */
const downloads = mkdtempSync(join(tmpdir(), "lamogen-judge-"));
let studio = await startStudio();
await visitStudio("desktop", "", { viewport: { width: 1440, height: 900 } }, async (page) => {
  let now = await state(page);
  check(now.motions === 1 && now.history === 1, "a motion is there at the beginning", now);
  await picture(page, "desktop-first");

  // A slider: the motion follows while one drags, and is in place after the release.
  await dragSlider(page, "factor-weight", 1.5, 12, 60, async () => (await state(page)).log.some(({ coarse }) => coarse));
  await settled(page);
  now = await state(page);
  check(now.sentence.factors[0] === 1.5 && now.request.weight === 1.5, "the slider sets the factor", now.sentence.factors);
  check(now.log.some(({ coarse }) => coarse), "coarse motions come while one drags", now.log);
  check(now.motions === 2 && now.labels.join() === "text alone,guided", "both motions are shown", now.labels);
  check(now.goals === "Weight 1.5", "the motion is the one that was asked for", now.goals);
  const shown = await page.evaluate(() => {
    const text = document.querySelector("#factors .slider .note").textContent;
    const { motions, target } = window.studio.scene;
    const percent = (motion) => Math.round(100 * (motion.laban.weight.mean / motions[0].laban.weight.mean - 1));
    return { text, asked: percent(target), after: percent(motions[1]) };
  });
  check(shown.text === `asked +${shown.asked} %, came out +${shown.after} %`, "the words under the slider are the numbers of the motion", shown);
  const dots = await page.evaluate(() => {
    window.studio.player.goTo(20);
    return new Promise((read) => requestAnimationFrame(() => requestAnimationFrame(() => {
      const values = [...document.querySelectorAll(".chart")][0].querySelectorAll(".values b");
      read({ shown: [...values].map((value) => Number(value.textContent)), expected: window.studio.scene.motions[1].series.weight[20] });
    })));
  });
  check(Math.abs(dots.shown[2] - dots.expected) < 0.01 * Math.max(dots.expected, 0.01) + 1e-3, "the curve has the motion's numbers", dots);
  await picture(page, "desktop");

  // No stale answer over a newer one: the numbers of answers rise, and the last is that of the last wish.
  for (const factor of [0.6, 1.8, 0.8, 1.4]) await dragSlider(page, "factor-weight", factor, 6, 15);
  await settled(page);
  now = await state(page);
  const numbers = now.log.map(({ number }) => number);
  check(numbers.every((number, i) => i === 0 || number > numbers[i - 1]), "answers come in the order of their requests", numbers);
  check(Math.abs(now.sentence.factors[0] - 1.4) < 1e-6 && now.goals === "Weight 1.4", "the last wish wins", now.goals);

  // An answer that is late is not shown.
  let held = null;
  await page.route("**/api/v1/generate", async (route) => {
    if (held) return route.continue();
    held = route;
  });
  await page.locator("#dice").click();
  await page.waitForFunction(() => window.studio.busy);
  while (!held) await page.waitForTimeout(10);
  const rolled = (await state(page)).wish.seed;
  await page.locator("#dice").click();
  await settled(page);
  await held.continue().catch(() => {});
  await page.waitForTimeout(700);
  now = await state(page);
  check(now.wish.seed !== rolled && (await page.evaluate(() => window.studio.scene.seed)) === now.wish.seed, "an answer that is late is not shown", now.wish.seed);
  await page.unroute("**/api/v1/generate");

  // How long it takes.
  const [waits, previews] = [[], []];
  for (const [id, factor] of [["factor-weight", 0.7], ["factor-shape", 1.5], ["factor-time", 1.2], ["factor-flow", 0.8], ["factor-weight", 1.5], ["factor-shape", 0.8], ["factor-time", 0.9]]) {
    const before = (await state(page)).log.length;
    await dragSlider(page, id, factor, 10, 50);
    await settled(page);
    const { log } = await state(page);
    waits.push(log.at(-1).milliseconds);
    previews.push(...log.slice(before).filter(({ coarse }) => coarse).map(({ milliseconds }) => milliseconds));
  }
  const round = (numbers) => numbers.map(Math.round);
  console.log(`note  from release to the motion in place: median ${Math.round(median(waits))} ms of ${round(waits)}`);
  console.log(`note  coarse motions while dragging: median ${Math.round(median(previews))} ms of ${previews.length}`);
  console.log(`note  ${cpus().length} processors, load ${loadavg().map((load) => load.toFixed(1)).join(" ")}`);

  // Undo, history, link.
  const before = await state(page);
  await page.locator("#undo").click();
  now = await state(page);
  check(now.sentence.factors[1] === 1.2 && now.history === before.history, "undo brings the last motion back", now.sentence.factors);
  check((await page.locator("#factor-time").inputValue()) === "1.2", "and its slider");
  await page.keyboard.press("Control+z");
  const undone = await state(page);
  check(undone.sentence.factors[3] !== now.sentence.factors[3], "the key does the same", undone.sentence.factors);
  check((await page.locator(".thumbnail").count()) === before.history, "each motion has a thumbnail");
  await page.locator(".thumbnail").first().click();
  now = await state(page);
  check(JSON.stringify(now.wish) === JSON.stringify(before.wish), "a thumbnail brings its motion back", now.wish);

  // Keys over time.
  const lane = await page.locator("#lane").boundingBox();
  const laneAt = (time, factor) => [lane.x + 40 + (time / 4) * (lane.width - 54), lane.y + 12 + (1 - (factor - 0.2) / 1.8) * (lane.height - 32)];
  await page.mouse.click(...laneAt(1, 1));
  await settled(page);
  await page.mouse.move(...laneAt(3, 1));
  await page.mouse.down();
  await page.mouse.move(...laneAt(3, 1.3), { steps: 4 });
  await page.mouse.move(...laneAt(3, 1.6), { steps: 4 });
  await page.mouse.up();
  await settled(page);
  now = await state(page);
  check(now.sentence.keys[0].length === 3 && Math.abs(now.sentence.keys[0][2].factor - 1.6) < 0.06, "keys are set and dragged", now.sentence.keys[0]);
  check(typeof now.request.weight === "string" && now.request.weight.includes("~"), "and are a factor over time", now.request.weight);
  await page.locator("#lane [data-key='1']").focus();
  const focused = now.sentence.keys[0][1];
  await page.keyboard.press("ArrowUp");
  await page.keyboard.press("ArrowRight");
  now = await state(page);
  check(Math.abs(now.sentence.keys[0][1].factor - focused.factor - 0.05) < 1e-6 && Math.abs(now.sentence.keys[0][1].time - focused.time - 0.05) < 1e-6, "arrow keys move a key", now.sentence.keys[0]);
  await settled(page);
  await picture(page, "desktop-keys");
  await page.locator("#lane [data-key='1']").focus();
  await page.keyboard.press("Delete");
  await settled(page);
  check((await state(page)).sentence.keys[0].length === 2, "delete removes it");

  // Parts of the body.
  await page.locator("#parts > summary").click();
  await page.locator("#part-add").selectOption("arms");
  await page.locator("#part-arms-weight").fill("1.5");
  await page.locator("#part-arms-weight").dispatchEvent("change");
  await settled(page);
  now = await state(page);
  check(now.request.part?.[0] === "arms:weight=1.5" && now.goals.includes("arms"), "arms have a factor of their own", [now.request, now.goals]);
  const link = page.url();
  const wished = now;

  // A file: its report, and the motion like it.
  await page.locator("#file").setInputFiles(bvh);
  await page.waitForFunction(() => window.studio.dropped);
  now = await state(page);
  check(now.labels.includes(basename(bvh)), "a file is shown beside", now.labels);
  const cells = await page.locator("#report td").allTextContents();
  const maximum = await page.evaluate(() => window.studio.dropped.report.motions[0].laban.weight.maximum);
  check(cells.length === 8 && Number(cells[0]) === Number(maximum.toPrecision(3)), "its report is there", cells);
  await page.locator("#keys-clear").click();
  await settled(page);
  await page.locator("#report button").first().click();
  await settled(page);
  now = await state(page);
  check(now.request.like !== undefined, "it can be the goal", Object.keys(now.request));
  await picture(page, "desktop-dropped");
  const likeLink = page.url();

  // Errors are said where they are, and what was there stays.
  await page.locator("#file").setInputFiles({ name: "broken.bvh", mimeType: "text/plain", buffer: Buffer.from("HIERARCHY\nROOT") });
  await page.waitForFunction(() => !document.getElementById("file-problem").hidden);
  check((await page.locator("#file-problem").textContent()).includes("broken.bvh"), "a broken file says what is wrong with it");
  await page.locator("#seconds").fill("99");
  await page.locator("#seconds").blur();
  check((await page.locator("#seconds-problem").textContent()).includes("2 to 60"), "a length that cannot be says which can");
  await page.locator("#prompt").fill("");
  await page.waitForFunction(() => !document.getElementById("prompt-problem").hidden);
  check(await page.locator("#prompt").getAttribute("aria-invalid") === "true", "an empty sentence is said at the sentence");
  await page.locator("#prompt").fill("a person waves");
  await settled(page);
  check((await page.evaluate(() => window.studio.scene.prompt)) === "a person waves", "typing gives the motion of the sentence");
  check(!(await page.locator("#prompt-problem").isVisible()), "and the error is gone");
  await page.locator("#prompt").fill("xqz blorf");
  await settled(page);
  check((await page.locator("#prompt-note").textContent()).includes("no word"), "unknown words are said", await page.locator("#prompt-note").textContent());

  // Keep it: a file, opened again.
  await page.locator("#prompt").fill("a person jumps");
  await settled(page);
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator("#exports button", { hasText: "BVH" }).click()]);
  check(download.suggestedFilename() === "a-person-jumps.bvh", "a file has the name of its sentence", download.suggestedFilename());
  const kept = join(downloads, "kept.bvh");
  await download.saveAs(kept);
  check(readFileSync(kept, "utf8").startsWith("HIERARCHY"), "a BVH is kept");
  await page.locator("#file").setInputFiles(kept);
  await page.waitForFunction(() => window.studio.dropped?.name === "kept.bvh");
  const apart = await page.evaluate(() => {
    const [a, b] = [window.studio.scene.motions.at(-1).laban.weight.mean, window.studio.dropped.report.motions[0].laban.weight.mean];
    return Math.abs(a / b - 1);
  });
  check(apart < 1e-3, "and is the motion when it is opened again", apart);

  // Links.
  for (const [address, claim] of [[link, "a link gives the motion again"], [likeLink, "a link with a motion to be like, too"]]) {
    await openLink(page, address);
    now = await state(page);
    if (address === link) check(JSON.stringify(now.means) === JSON.stringify(wished.means), claim, [now.means, wished.means]);
    else check(now.request.like !== undefined, claim);
  }
  check((await nameless(page)).length === 0, "every control has a name", await nameless(page));
  await page.keyboard.press("?");
  check(await page.locator("#help").isVisible(), "? opens the help");
  await page.keyboard.press("Escape");
  await noOverflow(page, "desktop");

  // Two tabs.
  const other = await page.context().newPage();
  await other.goto(studio.address);
  await settled(other);
  await Promise.all([dragSlider(other, "factor-shape", 1.5), page.locator("#dice").click()]);
  await Promise.all([settled(page), settled(other)]);
  check((await state(other)).goals === "Shape 1.5" && !(await state(page)).goals.includes("Shape 1.5"), "two tabs do not disturb each other");
  await other.close();

  // The server goes away and comes back.
  const { port } = new URL(studio.address);
  const code = await studio.end();
  check(code === 0, "the server ends in order", code);
  await page.locator("#dice").click();
  await page.waitForFunction(() => document.getElementById("status").textContent.includes("does not answer"));
  check(true, "the page says that the server is away");
  const seed = (await state(page)).wish.seed;
  studio = await startStudio(port);
  await settled(page);
  await page.waitForFunction((expected) => window.studio.scene.seed === expected, seed, { timeout: 60_000 });
  check(true, "and goes on when it is back");
});

await visitStudio("sentences in a row", `#prompt=a+person+walks+forward&seconds=3&seed=1`, { viewport: { width: 1440, height: 900 } }, async (page) => {
  await page.locator("#segment-add").click();
  check(await page.evaluate(() => document.activeElement.id) === "prompt", "a new sentence can be written at once");
  await page.keyboard.type("a person jumps");
  await settled(page);
  let now = await state(page);
  check(now.chosen === 1 && now.request.prompt === "a person walks forward" && now.request.then?.[0]?.prompt === "a person jumps" && now.request.then[0].seconds === 3, "a sentence is added", now.request);
  const borders = await page.evaluate(() => window.studio.scene.sentences.map(({ from, until }) => [from, until]));
  check(JSON.stringify(borders) === "[[0,3],[3,6]]", "and the motion has both", borders);
  check(await page.locator("#cycle").isDisabled(), "several sentences make no loop");

  // Sliders and keys are those of the chosen sentence.
  await dragSlider(page, "factor-weight", 1.5);
  await settled(page);
  now = await state(page);
  check(now.request.weight === undefined && now.request.then[0].weight === 1.5, "a slider belongs to the chosen sentence", now.request);
  const shown = await page.evaluate(() => {
    const { motions, target } = window.studio.scene;
    const mean = ({ series }) => series.weight.slice(60, 120).reduce((sum, value) => sum + value / 60, 0);
    const [before, asked, after] = [motions[0], target, motions[1]].map(mean);
    return { text: document.querySelector("#factors .slider .note").textContent, asked: Math.round(100 * (asked / before - 1)), after: Math.round(100 * (after / before - 1)) };
  });
  check(shown.text === `asked +${shown.asked} %, came out +${shown.after} %`, "the words under it are the numbers of that sentence", shown);
  await page.locator("#segments [data-segment='0']").click();
  check((await page.locator("#factor-weight").inputValue()) === "1" && (await page.locator("#prompt").inputValue()) === "a person walks forward", "a click chooses the other sentence");
  await page.locator("#segments [data-segment='1']").click();
  check((await page.locator("#factor-weight").inputValue()) === "1.5", "and back");
  const time = await page.evaluate(() => window.studio.player.time);
  check(Math.abs(time - 3) < 1e-6, "the player goes to the beginning of a sentence", time);
  const lane = await page.locator("#lane").boundingBox();
  await page.mouse.click(lane.x + 40 + (lane.width - 54) / 2, lane.y + lane.height / 2);
  await settled(page);
  now = await state(page);
  check(String(now.request.then[0].weight).includes("1.5:"), "keys count from the beginning of their sentence", now.request.then[0].weight);

  // Lengths.
  const track = await page.locator("#segments").boundingBox();
  const at = (seconds) => [track.x + (track.width * seconds) / 6 - 3, track.y + track.height / 2];
  await page.mouse.move(...at(3));
  await page.mouse.down();
  await page.mouse.move(...at(2.8), { steps: 3 });
  await page.mouse.move(...at(2.5), { steps: 3 });
  await page.mouse.up();
  await settled(page);
  now = await state(page);
  const from = await page.evaluate(() => window.studio.scene.sentences[1].from);
  check(Math.abs(now.request.seconds - 2.5) < 0.051 && now.request.then[0].seconds === 3 && Math.abs(from - now.request.seconds) < 1e-6, "the end of a sentence is dragged", [now.request, from]);
  await page.locator("#segments [data-end='1']").focus();
  await page.keyboard.press("ArrowLeft");
  await settled(page);
  now = await state(page);
  check(now.request.then[0].seconds === 2.9, "and moved by keys", now.request.then);
  check(await page.evaluate(() => document.activeElement.dataset.end) === "1", "which keep the focus");
  await picture(page, "sentences");
  await page.evaluate(() => window.studio.player.seek(0));

  // Another order, removing, undo, link, export.
  const before = await state(page);
  await page.locator("#segment-earlier").click();
  await settled(page);
  now = await state(page);
  check(now.request.prompt === "a person jumps" && now.request.then[0].prompt === "a person walks forward", "a sentence is moved", now.request);
  await page.locator("#segments [data-segment='1']").focus();
  await page.keyboard.press("Delete");
  await settled(page);
  now = await state(page);
  check(now.request.then === undefined && now.request.prompt === "a person jumps", "and removed", now.request);
  await page.locator("#undo").click();
  await page.locator("#undo").click();
  now = await state(page);
  check(JSON.stringify(now.request) === JSON.stringify(before.request) && JSON.stringify(now.means) === JSON.stringify(before.means), "undo brings back order and sentence", now.request);
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator("#exports button", { hasText: "BVH" }).click()]);
  const kept = join(downloads, "row.bvh");
  await download.saveAs(kept);
  const frames = Number(readFileSync(kept, "utf8").match(/Frames:\s*(\d+)/)[1]);
  check(frames === Math.round(20 * (before.request.seconds + 2.9)), "the file has all sentences", frames);
  await openLink(page);
  now = await state(page);
  check(JSON.stringify(now.request) === JSON.stringify(before.request) && JSON.stringify(now.means) === JSON.stringify(before.means), "a link gives all sentences again", now.request);
  await page.locator("#segments [data-segment='1']").click();
  await page.locator("#prompt").fill("");
  await page.waitForFunction(() => !document.getElementById("prompt-problem").hidden);
  check((await page.locator("#prompt-problem").textContent()).includes("sentence 2"), "an empty sentence is named");
  check((await nameless(page)).length === 0, "sentences: every control has a name", await nameless(page));
  await noOverflow(page, "sentences");
});

await visitStudio("places", `#prompt=a+person+walks+forward&seconds=4&seed=1`, { viewport: { width: 1440, height: 900 } }, async (page) => {
  await page.locator("#places > summary").click();
  await page.locator("#floor").scrollIntoViewIfNeeded();
  /** Returns where a point of the floor is on the screen, by the lines at 0 and by a place whose metres are known. */
  const spot = (x, z) =>
    page.evaluate(([x, z]) => {
      const box = document.getElementById("floor").getBoundingClientRect();
      const { middle, scale } = window.studio.floor.frame;
      return [box.x + box.width / 2 - (x - middle[0]) * scale, box.y + box.height / 2 - (z - middle[1]) * scale];
    }, [x, z]);
  await page.mouse.click(...(await spot(0.5, 1)));
  await settled(page);
  let now = await state(page);
  const first = now.wish.path[0];
  check(now.wish.path.length === 1 && Math.abs(first.x - 0.5) < 0.051 && Math.abs(first.z - 1) < 0.051 && first.time === 4, "a click sets a place at the end", now.wish.path);
  check(await page.locator("#cycle").isDisabled(), "a path makes no loop");
  const places = () => page.evaluate(() => window.studio.scene.places);
  let reached = await places();
  check(reached.length === 1 && reached[0].off_m < 0.02, "the motion goes there", reached);
  check((await page.locator("#place-list output").textContent()) === `${(100 * reached[0].off_m).toFixed(1)} cm off`, "the page says how near it comes");
  await page.mouse.click(...(await spot(-0.3, 1.6)));
  await settled(page);
  now = await state(page);
  check(now.wish.path.length === 2 && now.wish.path[1].time === 4 && now.wish.path[0].time < 3.5, "a second place follows, and the first comes earlier", now.wish.path);
  const trace = await page.evaluate(() => {
    const [dx, dz] = window.studio.floor.trace.at(-1);
    const { joints } = window.studio.scene.motions.at(-1);
    return [dx - joints.at(-1)[0][0], dz - joints.at(-1)[0][2], document.querySelector("#floor .trace").getAttribute("d").length];
  });
  check(trace[0] === 0 && trace[1] === 0 && trace[2] > 100, "the trace is that of the pelvis", trace);
  // Dragged, moved by keys, typed.
  const grip = await spot(now.wish.path[1].x, now.wish.path[1].z);
  const to = await spot(-0.8, 1.2);
  await page.mouse.move(...grip);
  await page.mouse.down();
  await page.mouse.move((grip[0] + to[0]) / 2, (grip[1] + to[1]) / 2, { steps: 3 });
  await page.mouse.move(...to, { steps: 3 });
  await page.mouse.up();
  await settled(page);
  now = await state(page);
  check(Math.abs(now.wish.path[1].x + 0.8) < 0.051 && Math.abs(now.wish.path[1].z - 1.2) < 0.051, "a place is dragged", now.wish.path);
  await page.locator("#floor [data-place='1']").focus();
  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("ArrowUp");
  await page.keyboard.press("PageDown");
  const moved = (await state(page)).wish.path[1];
  check(Math.abs(moved.x - now.wish.path[1].x - 0.1) < 1e-6 && Math.abs(moved.z - now.wish.path[1].z - 0.1) < 1e-6 && Math.abs(moved.time - 3.9) < 1e-6, "arrow and page keys move a place", moved);
  await page.locator("[data-field='0 time']").fill("1.5");
  await page.locator("[data-field='0 time']").blur();
  await settled(page);
  now = await state(page);
  check(now.wish.path[0].time === 1.5 && now.request.path.startsWith("1.5:"), "a time is typed", now.request.path);
  reached = await places();
  check(reached.length === 2 && reached.every(({ off_m: off }) => off < 0.02), "the motion passes all places", reached);
  await picture(page, "places");
  const before = now;
  await page.locator("#floor [data-place='0']").focus();
  await page.keyboard.press("Delete");
  await settled(page);
  check((await state(page)).wish.path.length === 1, "delete removes a place");
  await page.locator("#undo").click();
  now = await state(page);
  check(JSON.stringify(now.request) === JSON.stringify(before.request), "undo brings it back", now.request);
  check((await page.locator("#place-list li").count()) === 2, "and its line");
  await openLink(page);
  now = await state(page);
  check(JSON.stringify(now.request) === JSON.stringify(before.request) && JSON.stringify(now.means) === JSON.stringify(before.means), "a link gives the places again", now.request);
  check((await nameless(page)).length === 0, "places: every control has a name", await nameless(page));
  await noOverflow(page, "places");
  // Where the body faces on the path.
  await page.locator("#face").selectOption("degrees");
  await page.locator("#face-degrees").fill("90");
  await page.locator("#face-degrees").blur();
  await settled(page);
  now = await state(page);
  check(now.request.face === 90 && page.url().includes("face=90"), "the body faces a direction on its path", now.request);
  const facing = await page.evaluate(() => {
    const { joints } = window.studio.scene.motions.at(-1);
    const pose = joints[Math.floor(joints.length / 2)];
    // The left hip is on the left: a body that faces left has it behind.
    return Math.atan2(pose[2][2] - pose[1][2], pose[1][0] - pose[2][0]) * (180 / Math.PI);
  });
  check(Math.abs(facing - 90) < 25, "and does", facing);
  await page.locator("#face").selectOption("path");
  await settled(page);
  check((await state(page)).request.face === undefined, "along the path is what needs no words");
  await page.locator("#places-clear").click();
  await settled(page);
  check((await state(page)).request.path === undefined && (await page.locator("#facing").isHidden()), "all places are removed");
});

await visitStudio("positions", `#prompt=a+person+raises+the+right+arm&seconds=3&seed=2`, { viewport: { width: 1440, height: 900 } }, async (page) => {
  const places = () => page.evaluate(() => window.studio.scene.places ?? []);
  /** Returns where the mark of a position is on the screen, in the view of the last motion. */
  const mark = (i) =>
    page.evaluate(async (i) => {
      const { stage, wish } = window.studio;
      while (!stage.layout) await new Promise(requestAnimationFrame);
      const box = document.getElementById("stage").getBoundingClientRect();
      const { cell } = stage.layout.all.at(-1);
      const { x, y, z } = wish.reaches[i];
      const at = stage.lensAt([cell.x + cell.width / 2, cell.y + cell.height / 2]).project([x, y, z]);
      return [box.x + at.x, box.y + at.y, at.scale];
    }, i);
  await page.evaluate(() => window.studio.player.seek(1.5));
  await page.locator("#reaches > summary").click();
  await page.locator("#reach-add").selectOption("right-hand");
  await settled(page);
  let now = await state(page);
  const first = now.wish.reaches[0];
  check(now.wish.reaches.length === 1 && first.part === "right-hand" && first.time === 1.5 && first.y > 0.5, "a part is added where it is at that moment", now.wish.reaches);
  check(/^right-hand@1.5=/.test(now.request.reach[0]), "and is in the request", now.request.reach);
  check((await places())[0].off_m < 0.02, "the motion reaches it", await places());
  const notes = await page.locator("#factors .note").allTextContents();
  check(notes.every((text) => text.startsWith("came out")), "nothing is asked of the components beside it", notes);
  // Dragged in the view: up by 20 cm, to the side by 10.
  const [x, y, scale] = await mark(0);
  const camera = await page.evaluate(() => [window.studio.stage.camera.azimuth, window.studio.stage.camera.elevation]);
  await page.mouse.move(x, y);
  check(await page.locator("#stage").evaluate((stage) => stage.classList.contains("on-mark")), "the cursor says that a mark can be moved");
  await page.mouse.down();
  await page.mouse.move(x - 0.05 * scale, y - 0.1 * scale, { steps: 4 });
  await page.mouse.move(x - 0.1 * scale, y - 0.2 * scale, { steps: 4 });
  await page.mouse.up();
  await settled(page);
  now = await state(page);
  const moved = now.wish.reaches[0];
  check(Math.abs(moved.y - first.y - 0.2) < 0.03, "a mark is dragged in parallel to the picture", [first, moved]);
  check(JSON.stringify(camera) === JSON.stringify(await page.evaluate(() => [window.studio.stage.camera.azimuth, window.studio.stage.camera.elevation])), "and the camera stays");
  let reached = await places();
  check(reached[0].off_m < 0.03, "the motion follows", reached);
  check((await page.locator("#reach-list output").textContent()) === `${(100 * reached[0].off_m).toFixed(1)} cm off`, "the page says how near it comes");
  // Beside the mark, the camera turns as before.
  await page.mouse.move(x - 0.1 * scale + 60, y + 120);
  await page.mouse.down();
  await page.mouse.move(x - 0.1 * scale + 120, y + 120, { steps: 3 });
  await page.mouse.up();
  check(camera[0] !== (await page.evaluate(() => window.studio.stage.camera.azimuth)), "beside the mark the camera turns");
  await page.locator("#reset").click();
  // Typed.
  await page.locator("#reach-list [data-field='0 y']").fill("1.2");
  await page.locator("#reach-list [data-field='0 y']").blur();
  await settled(page);
  check((await state(page)).wish.reaches[0].y === 1.2, "a height is typed");
  await page.locator("#reach-add").selectOption("left-foot");
  await settled(page);
  now = await state(page);
  check(now.wish.reaches.length === 2 && (await places()).length === 2, "a second part", now.request.reach);
  await picture(page, "positions");
  await openLink(page);
  const again = await state(page);
  check(JSON.stringify(again.request) === JSON.stringify(now.request) && JSON.stringify(again.means) === JSON.stringify(now.means), "a link gives the positions again", again.request);
  await page.locator("#reach-list li:nth-child(2) button").click();
  await settled(page);
  check((await state(page)).wish.reaches.length === 1, "a position is removed");
  await page.locator("#undo").click();
  await settled(page);
  check((await state(page)).wish.reaches.length === 2, "undo brings it back");
  await page.locator("#seconds").fill("2.1");
  await page.locator("#seconds").blur();
  await settled(page);
  check((await state(page)).request.reach.length === 2, "positions before the end stay when the motion gets shorter");
  await page.locator("#reach-list [data-field='0 time']").fill("9");
  await page.locator("#reach-list [data-field='0 time']").blur();
  await settled(page);
  check((await state(page)).wish.reaches[0].time === 2.1, "a moment past the end is the end");
  check((await nameless(page)).length === 0, "positions: every control has a name", await nameless(page));
  await noOverflow(page, "positions");
});

/** Returns a GLB all of whose vertices have a colour, four bytes. */
function withVertexColours(file, colour) {
  const length = file.readUInt32LE(12);
  const document = JSON.parse(file.subarray(20, 20 + length));
  const pieces = [file.subarray(20 + length + 8)];
  let size = pieces[0].length;
  for (const { primitives } of document.meshes) {
    for (const { attributes } of primitives) {
      const { count } = document.accessors[attributes.POSITION];
      attributes.COLOR_0 = document.accessors.push({ bufferView: document.bufferViews.length, componentType: 5121, normalized: true, count, type: "VEC4" }) - 1;
      document.bufferViews.push({ buffer: 0, byteOffset: size, byteLength: 4 * count });
      pieces.push(Buffer.alloc(4 * count, Buffer.from(colour)));
      size += 4 * count;
    }
  }
  document.buffers[0].byteLength = size;
  const json = Buffer.from(JSON.stringify(document));
  const padded = Buffer.concat([json, Buffer.alloc((4 - (json.length % 4)) % 4, " ")]);
  const head = (...numbers) => Buffer.from(new Uint32Array(numbers).buffer);
  return Buffer.concat([head(0x46546c67, 2, 28 + padded.length + size), head(padded.length, 0x4e4f534a), padded, head(size, 0x004e4942), ...pieces]);
}

await visitStudio("a character", `#prompt=a+person+jumps&seconds=4&seed=1&weight=1.5`, { viewport: { width: 1440, height: 900 } }, async (page) => {
  const figure = await state(page);
  await page.locator("#file").setInputFiles(vrm);
  await page.waitForFunction(() => window.studio.character?.isDrawn);
  await settled(page);
  let now = await state(page);
  check(JSON.stringify(now.means) === JSON.stringify(figure.means), "a character has the same motion", now.means);
  check((await page.locator("#character").textContent()).includes("a skeleton as VRM"), "the page says what it is", await page.locator("#character").textContent());
  /** Where the character is on the canvas: the number of its pixels and the middle of each view's, in CSS pixels. */
  const painted = () =>
    page.evaluate(async () => {
      const { stage, painter, player } = window.studio;
      // What has changed is arranged in the next frame of the browser.
      while (!stage.layout) await new Promise(requestAnimationFrame);
      player.seek(1.7);
      stage.draw();
      const { gl, canvas } = painter;
      const pixels = new Uint8Array(4 * canvas.width * canvas.height);
      gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      const views = stage.layout.all.map(({ cell }) => ({ cell, count: 0, sum: [0, 0] }));
      const colour = [0, 0, 0];
      for (let i = 0; i < pixels.length / 4; i++) {
        if (pixels[4 * i + 3] === 0) continue;
        const [x, y] = [(i % canvas.width) / stage.layout.ratio, (canvas.height - Math.floor(i / canvas.width)) / stage.layout.ratio];
        const view = views.find(({ cell }) => x >= cell.x && x < cell.x + cell.width);
        view.count += 1;
        view.sum[0] += x;
        view.sum[1] += y;
        for (let channel = 0; channel < 3; channel++) colour[channel] += pixels[4 * i + channel];
      }
      const { lens } = stage;
      const joints = window.studio.scene.motions.at(-1).joints[34];
      return { views: views.map(({ count, sum }) => ({ count, middle: sum.map((x) => x / count) })), spine: (({ x, y }) => [x, y])(lens.project(joints[3])), colour, error: gl.getError() };
    });
  let paint = await painted();
  check(paint.error === 0 && paint.views.length === 2 && paint.views.every(({ count }) => count > 1500), "it is drawn in both views", paint);
  const away = Math.hypot(paint.views[1].middle[0] - paint.spine[0], paint.views[1].middle[1] - paint.spine[1]);
  check(away < 30, "and it is where the motion is", [away, paint]);
  await picture(page, "character");
  await dragSlider(page, "factor-shape", 1.4, 12, 60, async () => (await state(page)).log.some(({ coarse }) => coarse));
  await settled(page);
  check(await page.evaluate(() => window.studio.character.isDrawn && window.studio.scene.onto === window.studio.character.onto && window.studio.stage.motions.every((motion) => motion.isDrawnElsewhere)), "the motion that follows a slider is on it");

  // The file with the motion, opened again.
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator("#exports button", { hasText: "GLB" }).click()]);
  check(download.suggestedFilename() === `a-person-jumps-on-${basename(vrm)}`, "the file is the character's", download.suggestedFilename());
  const kept = join(downloads, "kept.vrm");
  await download.saveAs(kept);
  check(readFileSync(kept).length > readFileSync(vrm).length, "with the motion beside all that it had");
  await page.locator("#file").setInputFiles(kept);
  await page.waitForFunction(() => window.studio.dropped?.name === "kept.vrm" && window.studio.character?.name === "kept.vrm");
  check(await page.evaluate(() => !window.studio.character.isShown && Math.abs(window.studio.dropped.report.motions[0].seconds - 4) < 0.11), "opened again it is a motion of that length, and a character");
  await page.locator("#character button", { hasText: "Put the motion on it" }).click();
  await page.waitForFunction(() => window.studio.character.isDrawn && window.studio.scene.onto === window.studio.character.onto && !window.studio.busy);
  const apart = await page.evaluate(() => {
    const { scene, dropped, painter } = window.studio;
    const { joints } = dropped.report.motions[0];
    const { scale } = scene.motions.at(-1).character;
    const hips = painter.mesh.bones.findIndex((name) => /hips|pelvis/i.test(name));
    const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
    const poses = floats(scene.motions.at(-1).character.poses);
    const height = (frame) => poses[7 * (frame * painter.mesh.bones.length + hips) + 1];
    return Math.max(...[10, 20, 30, 40].map((frame) => Math.abs(height(frame) - height(0) - scale * (joints[frame][0][1] - joints[0][0][1]))));
  });
  check(apart < 0.005, "and its hips are as high in the page as in the file", apart);
  await page.locator("#report button", { hasText: "Remove" }).click();

  // Colours of vertices are multiplied with that of the material.
  await page.locator("#file").setInputFiles({ name: "red.vrm", mimeType: "model/gltf-binary", buffer: withVertexColours(readFileSync(vrm), [255, 0, 0, 255]) });
  await page.waitForFunction(() => window.studio.character?.name === "red.vrm" && window.studio.character.isDrawn);
  await settled(page);
  const [red, green, blue] = (await painted()).colour;
  // The text alone beside it is grey.
  check(red > 3 * green && green === blue, "vertices have their colours", [red, green, blue]);
  await page.locator("#file").setInputFiles(vrm);
  await page.waitForFunction((name) => window.studio.character?.name === name && window.studio.character.isDrawn, basename(vrm));
  await settled(page);

  // A server that was started again does not know it.
  const { port } = new URL(studio.address);
  await studio.end();
  studio = await startStudio(port);
  const before = await page.evaluate(() => window.studio.character.onto);
  await page.locator("#dice").click();
  await page.waitForFunction((before) => window.studio.character.onto !== before && window.studio.scene.onto === window.studio.character.onto, before, { timeout: 60_000 });
  await settled(page);
  check((await painted()).views[0].count > 1500, "a server that was started again gets it again");
  await page.locator("#undo").click();
  await page.waitForFunction(() => window.studio.scene.onto === window.studio.character.onto && !window.studio.busy);
  check(await page.evaluate(() => window.studio.stage.motions.every((motion) => motion.isDrawnElsewhere)), "undo keeps it");
  await page.locator("#file").setInputFiles({ name: "broken.vrm", mimeType: "model/gltf-binary", buffer: Buffer.from("glTF and no more") });
  await page.waitForFunction(() => !document.getElementById("file-problem").hidden);
  check((await page.locator("#file-problem").textContent()).includes("broken.vrm"), "a broken character says what is wrong with it", await page.locator("#file-problem").textContent());
  await page.locator("#character button", { hasText: "Remove" }).click();
  paint = await painted();
  check(paint.views.every(({ count }) => count === 0), "without it the figure is there again", paint);
  check((await nameless(page)).length === 0, "character: every control has a name", await nameless(page));
});
await visitStudio("a character without WebGL", "", { viewport: { width: 1440, height: 900 } }, async (page) => {
  await page.addInitScript(() => {
    const getContext = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
      return kind === "webgl2" ? null : getContext.call(this, kind, ...rest);
    };
  });
  await page.reload();
  await settled(page);
  await page.locator("#file").setInputFiles(vrm);
  await page.waitForFunction(() => window.studio.character?.isShown);
  await settled(page);
  check((await page.locator("#character").textContent()).includes("no WebGL 2") && (await page.evaluate(() => window.studio.stage.motions.every((motion) => !motion.isDrawnElsewhere))), "without WebGL the figure stands for it");
});

const phone = { viewport: { width: 360, height: 740 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true };
await visitStudio("phone", `#prompt=a+person+jumps&seconds=4&seed=1&weight=1.5`, phone, async (page) => {
  await noOverflow(page, "phone");
  await picture(page, "phone");
  const mark = page.locator("#factors .mark", { hasText: "light" });
  await mark.scrollIntoViewIfNeeded();
  await mark.tap();
  await settled(page);
  check((await state(page)).sentence.factors[0] === 0.5, "a tap on a word sets the factor");
  await page.evaluate(() => window.scrollTo(0, document.getElementById("panel").offsetHeight * 0.6));
  await page.waitForTimeout(100);
  const stage = await page.locator("#stage").boundingBox();
  const scrolled = await page.evaluate(() => window.scrollY);
  check(scrolled > 200 && stage.y >= 0 && stage.y < 5, "the figure stays in sight while one scrolls", stage);
  if (folder) {
    await page.screenshot({ path: join(folder, "phone-scrolled.png") });
    await page.screenshot({ path: join(folder, "phone-whole.png"), fullPage: true });
  }
});
const row = "prompt=a+person+walks+forward&seconds=3&seed=1&then=prompt%3Da%2Bperson%2Bjumps%26seconds%3D2%26weight%3D1.4&path=2:0.5,1.5+5:-0.5,3";
await visitStudio("phone, sentences and places", `#${row}`, phone, async (page) => {
  await noOverflow(page, "phone, sentences and places");
  await page.locator("#segments [data-segment='1']").tap();
  check((await state(page)).chosen === 1 && (await page.locator("#prompt").inputValue()) === "a person jumps", "a tap chooses a sentence");
  // Below the figure, which stays in sight.
  await page.locator("#floor").evaluate((floor) => floor.scrollIntoView({ block: "end" }));
  await page.locator("#floor").tap({ position: { x: 30, y: 190 } });
  await settled(page);
  const { wish } = await state(page);
  check(wish.path.length === 3 && wish.path[2].time === 5, "a tap sets a place", wish.path);
  if (folder) await page.screenshot({ path: join(folder, "phone-row-whole.png"), fullPage: true });
});
await visitStudio("phone, positions", `#prompt=a+person+waves&seconds=3&seed=1&reach=right-hand%401.5%3D-0.4,1.5,0.3`, phone, async (page) => {
  await noOverflow(page, "phone, positions");
  // A finger takes the mark and raises it.
  const at = await page.evaluate(async () => {
    const { stage, wish } = window.studio;
    window.scrollTo(0, 0);
    while (!stage.layout) await new Promise(requestAnimationFrame);
    const box = document.getElementById("stage").getBoundingClientRect();
    const { cell } = stage.layout.all.at(-1);
    const { x, y, z } = wish.reaches[0];
    const point = stage.lensAt([cell.x + cell.width / 2, cell.y + cell.height / 2]).project([x, y, z]);
    return [box.x + point.x, box.y + point.y, point.scale];
  });
  const finger = await page.context().newCDPSession(page);
  const touch = (type, points) => finger.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y]) => ({ x, y })) });
  await touch("touchStart", [[at[0] + 8, at[1] + 8]]);
  for (const share of [0.3, 0.6, 1]) await touch("touchMove", [[at[0] + 8, at[1] + 8 - 0.15 * share * at[2]]]);
  await touch("touchEnd", []);
  await settled(page);
  const { wish } = await state(page);
  check(Math.abs(wish.reaches[0].y - 1.65) < 0.04, "a finger moves a mark", wish.reaches);
  await page.locator("#reaches").scrollIntoViewIfNeeded();
  if (folder) await page.screenshot({ path: join(folder, "phone-positions.png") });
});
await visitStudio("phone, dark", `#prompt=a+person+jumps&seconds=4&seed=1&weight=1.5`, { ...phone, colorScheme: "dark" }, async (page) => {
  await picture(page, "phone-dark");
});
await visitStudio("dark", `#prompt=a+person+kicks&seconds=4&seed=1&weight=1.5&shape=1.3`, { viewport: { width: 1440, height: 900 }, colorScheme: "dark" }, async (page) => {
  const background = await page.evaluate(() => getComputedStyle(document.body).backgroundColor.match(/\d+/g).map(Number));
  check(background.every((part) => part < 60), "a dark page is dark", background);
  await picture(page, "dark");
});
await visitStudio("small laptop", "", { viewport: { width: 1180, height: 640 } }, async (page) => {
  await noOverflow(page, "small laptop");
  await picture(page, "laptop");
});
// The pictures of the README: a view of all, and a slider that is dragged.
if (folder) {
  await visitStudio("picture of all", `#prompt=a+person+walks+forward&seconds=3&seed=4&weight=1.3&then=prompt%3Da%2Bperson%2Bjumps%26seconds%3D2.5%26weight%3D1.5&path=2:0.4,1.2+5.5:-0.5,2.6`, { viewport: { width: 1240, height: 780 } }, async (page) => {
    await page.evaluate(() => {
      window.studio.player.seek(4.3);
      document.getElementById("places-clear").scrollIntoView({ block: "end" });
    });
    await page.waitForTimeout(200);
    await page.screenshot({ path: join(folder, "studio.png") });
  });
  mkdirSync(join(folder, "slider"), { recursive: true });
  await visitStudio("a slider that is dragged", `#prompt=a+person+jumps&seconds=3&seed=7`, { viewport: { width: 1120, height: 720 }, deviceScaleFactor: 0.6 }, async (page) => {
    const slider = await page.locator("#factor-weight").boundingBox();
    const at = (factor) => [slider.x + 11 + ((factor - 0.2) / 1.8) * (slider.width - 22), slider.y + slider.height / 2];
    const clip = { x: 0, y: 0, width: 1120, height: 560 };
    let shots = 0;
    const shoot = async () => page.screenshot({ path: join(folder, "slider", `${String((shots += 1)).padStart(3, "0")}.png`), clip });
    // Pictures take longer than they are shown, so time is set by hand.
    const go = (seconds) => page.evaluate((seconds) => window.studio.player.seek(seconds % window.studio.player.duration), seconds);
    await page.mouse.move(...at(1));
    await page.mouse.down();
    const factors = [...Array.from({ length: 20 }, (_, i) => 1 + (0.8 * i) / 19), ...Array.from({ length: 30 }, (_, i) => 1.8 - (1.3 * i) / 29)];
    for (const [i, factor] of factors.entries()) {
      await page.mouse.move(...at(factor));
      await page.waitForFunction((factor) => Math.abs(window.studio.sentence.factors[0] - factor) < 0.06, factor);
      await page.waitForTimeout(250);
      await go(0.11 * i);
      await shoot();
    }
    await page.mouse.up();
    await settled(page);
    for (let i = 0; i < 12; i++) {
      await go(0.11 * (factors.length + i));
      await shoot();
    }
  });
}

await studio.end();
rmSync(downloads, { recursive: true, force: true });
finish();
