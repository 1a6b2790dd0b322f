// Plays VRM animations on VRM characters with three-vrm in a real browser, and says which bones point elsewhere than in the
// motion.
//
//   npm install && node vrma.mjs WORK.json [FOLDER-FOR-PICTURES]
//
// The browser is /usr/bin/chromium, or the one that CHROMIUM names. Exit code 1 if anything failed.

import { mkdirSync, readFileSync } from "node:fs";
import { basename, dirname, extname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { check, finish, openBrowser, visit } from "./browser.mjs";

const [list, folder] = process.argv.slice(2);
if (!list) {
  console.error("usage: node vrma.mjs WORK.json [FOLDER-FOR-PICTURES]");
  process.exit(2);
}
if (folder) mkdirSync(folder, { recursive: true });
const { characters, animations } = JSON.parse(readFileSync(list, "utf8"));
/** The largest accepted angle between a bone and what the motion says, in degrees, and distance, in millimetres. */
const limits = { "°": 1, " mm": 1 };
const modules = join(dirname(fileURLToPath(import.meta.url)), "node_modules");
const address = "http://judge.test/";
const types = { ".js": "text/javascript", ".html": "text/html" };
const page = `<!doctype html><meta charset="utf-8"><title>VRM animations</title>
<style>body { margin: 0; background: #fff }</style>
<script type="importmap">{ "imports": {
  "three": "./modules/three/build/three.module.js",
  "three/addons/": "./modules/three/examples/jsm/",
  "@pixiv/three-vrm": "./modules/@pixiv/three-vrm/lib/three-vrm.module.js",
  "@pixiv/three-vrm-animation": "./modules/@pixiv/three-vrm-animation/lib/three-vrm-animation.module.js"
} }</script>
<script type="module" src="./player.mjs"></script>`;

/** Answers a request of the page: nothing comes from a network. */
function answer(route) {
  const path = decodeURIComponent(new URL(route.request().url()).pathname).slice(1);
  const [kind, ...rest] = path.split("/");
  const files = [...characters, ...animations].map(({ file }) => file);
  try {
    if (path === "") return route.fulfill({ contentType: "text/html", body: page });
    if (path === "favicon.ico") return route.fulfill({ status: 204, body: "" });
    if (path === "player.mjs") {
      const player = join(dirname(fileURLToPath(import.meta.url)), "player.mjs");
      return route.fulfill({ contentType: types[".js"], body: readFileSync(player) });
    }
    if (kind === "modules") {
      const body = readFileSync(join(modules, ...rest));
      return route.fulfill({ contentType: types[extname(path)] ?? "application/octet-stream", body });
    }
    const file = files.find((file) => basename(file) === rest.join("/"));
    return route.fulfill({ contentType: "application/octet-stream", body: readFileSync(file) });
  } catch (error) {
    return route.fulfill({ status: 404, body: String(error) });
  }
}

await visit("VRM animations", async () => {
  const context = await openBrowser({ viewport: { width: 1500, height: 420 } }, ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]);
  try {
    await context.route("**/*", answer);
    const tab = await context.newPage();
    const complaints = [];
    // What a software renderer says of its speed is no complaint about the files.
    const isOfRenderer = (text) => /GPU stall|software WebGL|GL Driver Message/.test(text);
    const complain = (text) => isOfRenderer(text) || complaints.includes(text) || complaints.push(text);
    tab.on("console", (message) => {
      if (["warning", "error"].includes(message.type())) complain(message.text());
    });
    tab.on("pageerror", (error) => complain(String(error)));
    await tab.goto(address);
    await tab.waitForFunction(() => window.play !== undefined, undefined, { timeout: 60_000 }).catch(() => {});
    for (const animation of animations) {
      for (const character of characters) {
        const name = `${basename(animation.file)} on ${basename(character.file)}`;
        console.log(`\n== ${name}`);
        const names = { character: basename(character.file), animation: basename(animation.file) };
        const found = await tab.evaluate(([names, expected]) => window.play(names, expected), [names, animation]);
        check(found.version === character.version, "it is read as VRM of its version", found.version);
        check(found.faces > 0.99, "it faces +Z in its rest pose", found.faces.toFixed(3));
        // The last keyframe, of 30 a second, is the nearest one to the last frame of the motion.
        check(Math.abs(found.duration - animation.duration) < 0.501 / 30, "it lasts as long", `${found.duration.toFixed(3)} s`);
        for (const [what, unit, worst] of [
          ["bones point where the motion's do", "°", found.directions],
          ["bones turn as the motion's do", "°", found.rotations],
          ["the hips go the motion's way in the character's size", " mm", found.hips],
        ]) {
          const limit = limits[unit];
          const where = worst.bone ? ` (${worst.bone}, ${worst.time.toFixed(2)} s)` : "";
          const measured = `${worst.most.toFixed(3)}${unit} at most${where}, ${worst.count} measured`;
          check(worst.most <= limit && worst.count > 0, `${what}, within ${limit}${unit}: ${measured}`);
        }
        if (folder) {
          const picture = join(folder, `${basename(animation.file, ".vrma")}-${basename(character.file, ".vrm")}.png`);
          const problem = await tab.evaluate((names) => window.draw(names), names);
          if (problem) console.log(`no picture: ${problem}`);
          else await tab.screenshot({ path: resolve(picture) });
        }
      }
    }
    check(complaints.length === 0, "three.js and three-vrm do not complain", complaints.join(" | "));
  } finally {
    await context.close();
  }
});

finish();
