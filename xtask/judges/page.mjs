// Uses a page in a real browser as people do, and says what does not work.
//
//   npm install && node page.mjs PAGE.html [FOLDER-FOR-SCREENSHOTS]
//
// The browser is /usr/bin/chromium, or the one that CHROMIUM names. Exit code 1 if anything failed.

import { mkdirSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { check, finish, openBrowser, openPage, visit } from "./browser.mjs";

const [file, folder] = process.argv.slice(2);
if (!file) {
  console.error("usage: node page.mjs PAGE.html [FOLDER-FOR-SCREENSHOTS]");
  process.exit(2);
}
const address = pathToFileURL(resolve(file)).href;
if (folder) mkdirSync(folder, { recursive: true });

/** Opens the page in a fresh browser and hands it to `use`; whatever it loads or complains of is a failure. */
const visitPage = (name, options, use) =>
  visit(name, async () => {
    const context = await openBrowser({ reducedMotion: "reduce", ...options }, ["--disable-gpu"]);
    try {
      const { page, complaints, loaded } = await openPage(context);
      await page.goto(address);
      await page.waitForFunction(() => window.lamogen !== undefined);
      await frames(page, 3);
      await use(page, context);
      check(complaints.length === 0, `${name}: the console is silent`, complaints);
      const others = loaded.filter((url) => url !== address && !url.startsWith("data:"));
      check(others.length === 0, `${name}: nothing else is loaded`, others);
    } finally {
      await context.close();
    }
  });

/** Waits until the page has drawn so many times. */
const frames = (page, count) =>
  page.evaluate(async (n) => {
    for (let i = 0; i < n; i++) await new Promise((drawn) => requestAnimationFrame(drawn));
  }, count);

const state = (page) =>
  page.evaluate(() => {
    const { time, duration, frame, frames, playing, speed, loop, overlay, follow, trails, camera } = window.lamogen;
    return { time, duration, frame, frames, playing, speed, loop, overlay, follow, trails, camera };
  });

/** The state as soon as it is as expected, or after five seconds of a busy machine. */
async function soon(page, expected) {
  const start = Date.now();
  for (;;) {
    const now = await state(page);
    if (expected(now) || Date.now() - start > 5000) return now;
    await page.waitForTimeout(30);
  }
}

async function after(page, action) {
  const before = await state(page);
  await action();
  await frames(page, 2);
  return [before, await state(page)];
}

async function press(page, key) {
  return after(page, () => page.keyboard.press(key));
}

async function picture(page, name) {
  if (!folder) return;
  await frames(page, 2);
  await page.screenshot({ path: join(folder, `${name}.png`) });
}

/** The middle of an element, and its box. */
async function place(page, selector) {
  const box = await page.locator(selector).first().boundingBox();
  return { ...box, x0: box.x, y0: box.y, x: box.x + box.width / 2, y: box.y + box.height / 2 };
}

/** Whether the canvas has something on it: how many different colours. */
const colours = (page) =>
  page.evaluate(() => {
    const canvas = document.getElementById("view");
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    const seen = new Set();
    for (let i = 0; i < data.length; i += 4 * 7) seen.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
    return seen.size;
  });

async function drag(page, from, to, button = "left") {
  await page.mouse.move(from.x, from.y);
  await page.mouse.down({ button });
  await page.mouse.move((from.x + to.x) / 2, (from.y + to.y) / 2);
  await page.mouse.move(to.x, to.y);
  await page.mouse.up({ button });
}

/** Fingers that move together: each is a list of points, as many for every finger. */
async function touch(context, page, ...fingers) {
  const session = await context.newCDPSession(page);
  const send = (type, touchPoints) => session.send("Input.dispatchTouchEvent", { type, touchPoints });
  const at = (i) => fingers.map((finger, id) => ({ x: finger[i][0], y: finger[i][1], id }));
  await send("touchStart", at(0));
  for (let i = 1; i < fingers[0].length; i++) await send("touchMove", at(i));
  await send("touchEnd", []);
  await session.detach();
}

async function noOverflow(page, name) {
  // Not the window's innerWidth: a phone's browser widens that to what is too wide.
  const screen = page.viewportSize().width;
  const content = await page.evaluate(() => document.documentElement.scrollWidth);
  check(content <= screen, `${name}: nothing reaches over the side`, [content, screen]);
}

/** In the page: the largest distance on any axis between poses on frames and the embedded numbers, in metres. */
function apartFromData() {
  const data = JSON.parse(document.getElementById("data").textContent);
  const bytes = (text) => new DataView(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  let worst = 0;
  data.motions.forEach((motion, m) => {
    const [pelvis, others] = [bytes(motion.pelvis), bytes(motion.others)];
    for (let frame = 0; frame < motion.frames; frame++) {
      window.lamogen.motions[m].pose(frame / data.rate).forEach((point, joint) => {
        point.forEach((value, axis) => {
          const root = pelvis.getFloat32(4 * (3 * frame + axis), true);
          const place = 3 * ((data.joints.length - 1) * frame + joint - 1) + axis;
          const expected = joint === 0 ? root : root + motion.step * others.getInt16(2 * place, true);
          worst = Math.max(worst, Math.abs(value - expected));
        });
      });
    }
  });
  return worst;
}

/** To the middle of the motion, where something happens. */
const toTheMiddle = (page) => page.evaluate(() => { window.lamogen.time = window.lamogen.duration * 0.55; });

await visitPage("desktop", { viewport: { width: 1440, height: 900 } }, async (page) => {
  const start = await state(page);
  check(!start.playing && start.time === 0, "reduced motion: it does not play by itself", start);
  const drawn = await colours(page);
  check(drawn > 100, "figures are drawn", drawn);
  const apart = await page.evaluate(apartFromData);
  check(apart < 1e-9, "on a frame every joint is where the file has it", apart);
  await toTheMiddle(page);
  await picture(page, "desktop");

  const moves = start.frames > 1;
  if (moves) {
    await page.evaluate(() => { window.lamogen.time = 0; });
    await page.keyboard.press("Space");
    const one = await soon(page, ({ time }) => time > 0);
    check(one.playing && one.time > 0, "space plays, and time goes on", one);
    await page.keyboard.press("Space");
    await frames(page, 2);
    const two = await state(page);
    await page.waitForTimeout(200);
    check(!two.playing && (await state(page)).time === two.time, "space pauses", two);
    await page.click("#play");
    check((await state(page)).playing, "the button plays");
    await page.click("#play");
    check(!(await state(page)).playing, "the button pauses");

    await press(page, "Home");
    let [before, now] = await press(page, "ArrowRight");
    check(now.frame === before.frame + 1 && Math.abs(now.time - 0.05) < 1e-9, "right goes a frame on", now);
    [before, now] = await press(page, "ArrowLeft");
    check(now.frame === before.frame - 1, "left goes a frame back", now);
    [, now] = await press(page, "ArrowLeft");
    check(now.frame === 0, "there is nothing before the first frame", now);
    [, now] = await press(page, "End");
    check(now.frame === now.frames - 1, "end goes to the last frame", now);
    [, now] = await press(page, "Home");
    check(now.frame === 0, "home goes to the first frame", now);
    [before, now] = await after(page, () => page.click("#forward"));
    check(now.frame === 1, "the button goes a frame on", now);

    const bar = await place(page, "#scrub");
    await drag(page, { x: bar.x0 + 12, y: bar.y }, { x: bar.x, y: bar.y });
    await frames(page, 2);
    now = await state(page);
    check(Math.abs(now.time / now.duration - 0.5) < 0.05 && !now.playing, "the bar is dragged with the mouse", now);
    const slider = await page.evaluate(() => {
      const bar = document.getElementById("scrub");
      return { text: bar.getAttribute("aria-valuetext"), value: Number(bar.value), out: document.getElementById("read-out").textContent };
    });
    check(slider.text.includes("seconds, frame") && slider.value === now.frame, "the bar says time and frame", slider);
    check(slider.out.includes(`frame ${now.frame + 1} of ${now.frames}`), "the read-out says the frame", slider);
    await page.focus("#scrub");
    [before, now] = await press(page, "ArrowRight");
    check(now.frame === before.frame + 1, "with the bar in focus right is one frame too", [before.frame, now.frame]);

    // Slow motion: at a tenth of the speed time goes a tenth as far.
    await page.selectOption("#speed", "0.1");
    await press(page, "Home");
    const passed = await page.evaluate(async () => {
      window.lamogen.playing = true;
      const frame = () => new Promise(requestAnimationFrame);
      await frame();
      const [clock, time] = [await frame(), window.lamogen.time];
      let last = clock;
      while (last - clock < 400) last = await frame();
      const result = (window.lamogen.time - time) / ((last - clock) / 1000);
      window.lamogen.playing = false;
      return result;
    });
    check(passed > 0.05 && passed < 0.15, "a tenth of the speed is a tenth", passed);
    [, now] = await press(page, ".");
    check(now.speed === 0.25, "the full stop plays faster", now.speed);
    await page.selectOption("#speed", "2");
    await press(page, "End");
    [, before] = await press(page, "ArrowLeft");
    await page.keyboard.press("Space");
    now = await soon(page, ({ playing, time }) => playing && time < before.time);
    check(now.playing && now.time < before.time, "it starts again at the end", now);
    await page.keyboard.press("l");
    await page.evaluate(() => { window.lamogen.time = window.lamogen.duration - 0.05; });
    now = await soon(page, ({ playing }) => !playing);
    check(!now.playing && now.frame === now.frames - 1 && !now.loop, "without the loop it stops there", now);
    await page.keyboard.press("l");
    await page.selectOption("#speed", "1");
  }

  const view = await place(page, "#view");
  let [before, now] = await after(page, () => drag(page, view, { x: view.x + 120, y: view.y + 40 }));
  check(now.camera.azimuth < before.camera.azimuth - 0.3, "a drag turns the view", now.camera);
  check(now.camera.elevation > before.camera.elevation + 0.1, "a drag tilts the view", now.camera);
  await picture(page, "desktop-turned");
  [before, now] = await after(page, () => drag(page, view, { x: view.x + 90, y: view.y }, "right"));
  check(Math.hypot(...now.camera.pan) > 0.1 && now.camera.azimuth === before.camera.azimuth, "a right drag moves the view", now.camera);
  await page.mouse.move(view.x, view.y);
  [before, now] = await after(page, () => page.mouse.wheel(0, -300));
  check(now.camera.zoom > before.camera.zoom * 1.2, "the wheel zooms", now.camera);
  [before, now] = await press(page, "-");
  check(now.camera.zoom < before.camera.zoom, "minus goes farther", now.camera);
  [before, now] = await press(page, "+");
  check(now.camera.zoom > before.camera.zoom, "plus goes closer", now.camera);
  [before, now] = await press(page, "Shift+ArrowLeft");
  check(now.camera.azimuth > before.camera.azimuth && now.frame === before.frame, "shift and left turn the view", now.camera);
  [, now] = await after(page, () => page.click("#reset"));
  check(JSON.stringify(now.camera) === JSON.stringify(start.camera), "reset brings the view back", [now.camera, start.camera]);

  if (await page.locator("#overlay").isVisible()) {
    [, now] = await after(page, () => page.click("#overlay"));
    check(now.overlay && (await page.getAttribute("#overlay", "aria-pressed")) === "true", "overlay is switched on");
    await toTheMiddle(page);
    await page.keyboard.press("t");
    await picture(page, "desktop-overlay-trails");
    check((await state(page)).trails, "trails are switched on");
    await page.keyboard.press("t");
    [, now] = await press(page, "o");
    check(!now.overlay, "and off by its key");
  }
  [before, now] = await press(page, "f");
  check(now.follow !== before.follow, "the view follows or stands");
  await press(page, "f");

  if (moves && (await page.locator(".chart").count()) > 0) {
    check((await page.locator(".chart").count()) === 4, "there are four panels");
    const cursor = () => page.getAttribute(".chart .cursor", "transform");
    await press(page, "Home");
    const first = await cursor();
    await press(page, "ArrowRight");
    check((await cursor()) !== first, "the cursor on the curves moves");
    const chart = await place(page, ".chart svg");
    await page.mouse.click(chart.x0 + chart.width * 0.8, chart.y);
    await frames(page, 2);
    now = await state(page);
    check(now.time > 0.6 * now.duration && now.time < 0.95 * now.duration, "a click on a curve goes there", now);
    await drag(page, chart, { x: chart.x0 + chart.width * 0.3, y: chart.y });
    await frames(page, 2);
    now = await state(page);
    check(now.time > 0.1 * now.duration && now.time < 0.4 * now.duration, "a drag on a curve scrubs", now);
  }

  await page.keyboard.press("?");
  check(await page.locator("#help").isVisible(), "? opens the help");
  await picture(page, "desktop-help");
  await page.keyboard.press("Escape");
  check(!(await page.locator("#help").isVisible()), "escape closes it");

  const nameless = await page.evaluate(() =>
    [...document.querySelectorAll("button, input, select, canvas")]
      .filter((element) => !(element.ariaLabel || element.labels?.length || element.textContent.trim()))
      .map((element) => element.outerHTML));
  check(nameless.length === 0, "every control has a name", nameless);
  await page.keyboard.press("Tab");
  const outline = await page.evaluate(() => getComputedStyle(document.activeElement).outlineStyle);
  check(outline !== "none", "the focus is seen", outline);
  await noOverflow(page, "desktop");
});

const phone = { viewport: { width: 360, height: 740 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true };
await visitPage("phone", phone, async (page, context) => {
  const start = await state(page);
  await noOverflow(page, "phone");
  const screen = await page.evaluate(() => document.getElementById("view").width / document.getElementById("view").clientWidth);
  check(Math.abs(screen - 2) < 0.05, "the canvas has the screen's pixels", screen);
  await toTheMiddle(page);
  await picture(page, "phone");
  const { x, y } = await place(page, "#view");
  let [before, now] = await after(page, () => touch(context, page, [[x, y], [x + 30, y + 10], [x + 70, y + 30]]));
  check(now.camera.azimuth < before.camera.azimuth - 0.2 && now.camera.zoom === before.camera.zoom, "one finger turns the view", now.camera);
  [before, now] = await after(page, () =>
    touch(context, page, [[x - 20, y], [x - 40, y], [x - 70, y]], [[x + 20, y], [x + 40, y], [x + 70, y]]));
  check(now.camera.zoom > before.camera.zoom * 1.5 && now.camera.azimuth === before.camera.azimuth, "a pinch zooms", now.camera);
  [before, now] = await after(page, () =>
    touch(context, page, [[x - 30, y], [x - 10, y - 10], [x + 20, y - 30]], [[x + 30, y], [x + 50, y - 10], [x + 80, y - 30]]));
  const moved = Math.hypot(...now.camera.pan.map((value, i) => value - before.camera.pan[i]));
  check(moved > 0.05 && Math.abs(now.camera.zoom / before.camera.zoom - 1) < 0.1, "two fingers move the view", now.camera);
  // A tap within a tenth of a second after a drag only stops the drag's swing, for the browser.
  await page.waitForTimeout(700);
  await page.tap("#reset");
  now = await soon(page, ({ camera }) => JSON.stringify(camera) === JSON.stringify(start.camera));
  check(JSON.stringify(now.camera) === JSON.stringify(start.camera), "a tap resets the view", now.camera);
  if (start.frames > 1) {
    await page.evaluate(() => { window.lamogen.time = 0; });
    await frames(page, 2);
    const bar = await place(page, "#scrub");
    await touch(context, page, [[bar.x0 + 12, bar.y], [bar.x, bar.y], [bar.x0 + bar.width * 0.75, bar.y]]);
    await frames(page, 2);
    now = await state(page);
    check(Math.abs(now.time / now.duration - 0.75) < 0.08, "the bar is dragged with a finger", now.time / now.duration);
    await page.waitForTimeout(700);
    await page.tap("#play");
    check((await soon(page, ({ playing }) => playing)).playing, "a tap plays");
    await page.tap("#play");
    if ((await page.locator(".chart").count()) > 0) {
      const chart = page.locator(".chart svg").first();
      await chart.scrollIntoViewIfNeeded();
      const box = await chart.boundingBox();
      const [low, middle, high] = [0.3, 0.4, 0.6].map((part) => [box.x + box.width * part, box.y + box.height / 2]);
      await touch(context, page, [low, middle, high]);
      await frames(page, 2);
      now = await state(page);
      check(now.time / now.duration > 0.45 && now.time / now.duration < 0.7, "a finger on a curve scrubs", now.time / now.duration);
    }
  }
  if (folder) await page.screenshot({ path: join(folder, "phone-whole.png"), fullPage: true });
});

await visitPage("dark", { viewport: { width: 1440, height: 900 }, colorScheme: "dark" }, async (page) => {
  const background = await page.evaluate(() => getComputedStyle(document.body).backgroundColor.match(/\d+/g).map(Number));
  check(background.every((part) => part < 60), "a dark page is dark", background);
  await toTheMiddle(page);
  await picture(page, "dark");
});

await visitPage("phone on its side", { ...phone, viewport: { width: 740, height: 360 } }, async (page) => {
  await noOverflow(page, "phone on its side");
  await toTheMiddle(page);
  await picture(page, "phone-side");
});

await visitPage("captions", { viewport: { width: 1280, height: 800 } }, async (page) => {
  const caption = () => page.evaluate(() => window.lamogen.caption);
  const texts = await page.locator("#captions button").allTextContents();
  if (texts.length === 0) {
    check(!(await page.locator("#captions").isVisible()) && (await caption()) === null, "without captions there is no list of them");
    return;
  }
  check((await caption()) === texts[0], "at the start the first caption holds", await caption());
  if (texts.length === 1) return;
  await page.locator("#captions button").last().click();
  const now = await soon(page, ({ frame }) => frame > 0);
  check(now.frame > 0 && !now.playing && (await caption()) === texts.at(-1), "a caption that is clicked is where the motion goes", now);
  await frames(page, 2);
  check((await page.locator("#caption").textContent()) === texts.at(-1), "the caption of the moment stands below the figures");
  check((await page.locator("#captions [aria-current]").count()) === 1, "it is marked in the list");
  const [, before] = await press(page, "ArrowLeft");
  check(before.frame === now.frame - 1 && (await caption()) === texts.at(-2), "a frame before, the one before holds", await caption());
  check((await page.locator(".chart .border").count()) === 4 * (texts.length - 1), "borders are marked in the curves");
  await noOverflow(page, "captions");
  await picture(page, "captions");
});

await visitPage("motion welcome", { viewport: { width: 1000, height: 700 }, reducedMotion: "no-preference" }, async (page) => {
  const now = await soon(page, ({ time }) => time > 0);
  check(now.playing === now.frames > 1 && (now.frames === 1 || now.time > 0), "it plays by itself", now);
  await noOverflow(page, "motion welcome");
});

await visit("without JavaScript", async () => {
  const context = await openBrowser({ javaScriptEnabled: false }, ["--disable-gpu"]);
  try {
    const page = await context.newPage();
    await page.goto(address);
    check(await page.locator("noscript p").isVisible(), "it says why nothing moves");
  } finally {
    await context.close();
  }
});

finish();
