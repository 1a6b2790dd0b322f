// What the judges that use a browser have in common: checks, and visits to a page in a fresh browser.
//
// The browser is /usr/bin/chromium, or the one that CHROMIUM names.

import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";

const profile = mkdtempSync(join(tmpdir(), "lamogen-judge-"));
let profiles = 0;
let failures = [];
let checks = 0;

/** Counts a claim about a page, and prints whether it holds. */
export function check(holds, claim, found = "") {
  checks += 1;
  console.log(`${holds ? "ok  " : "FAIL"}  ${claim}${holds || found === "" ? "" : `: found ${JSON.stringify(found)}`}`);
  if (!holds) failures.push(claim);
}

/** Returns the context of a new browser with a profile of its own. */
export const openBrowser = (options, args = []) =>
  chromium.launchPersistentContext(join(profile, String((profiles += 1))), {
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    headless: true,
    args: ["--headless", "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic", ...args],
    ...options,
  });

/** Opens a page in a browser. Returns it with all that its console says and all addresses that it loads, as they come. */
export async function openPage(context) {
  const page = await context.newPage();
  const [complaints, loaded] = [[], []];
  page.on("console", (message) => complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(String(error)));
  page.on("request", (request) => loaded.push(request.url()));
  return { page, complaints, loaded };
}

/**
 * Makes a visit: calls `use`, whose checks count. A visit with a failure is made a second time, because a browser on a busy
 * machine may miss a touch; what is wrong is wrong then as well. An exception is a failure, and does not end the other visits.
 */
export async function visit(name, use) {
  for (const isLast of [false, true]) {
    const before = [failures.length, checks];
    console.log(`\n== ${name}`);
    try {
      await use();
    } catch (error) {
      check(false, `${name}: the visit came to its end: ${error.stack}`);
    }
    if (failures.length === before[0] || isLast) return;
    console.log(`\n${name}: ${failures.length - before[0]} checks failed; the visit is made again`);
    failures = failures.slice(0, before[0]);
    checks = before[1];
  }
}

/** Prints how many checks hold, and ends the judge with exit code 1 if one does not. */
export function finish() {
  rmSync(profile, { recursive: true, force: true });
  console.log(failures.length === 0 ? `\nall ${checks} checks hold` : `\n${failures.length} of ${checks} checks failed:\n- ${failures.join("\n- ")}`);
  process.exit(failures.length === 0 ? 0 : 1);
}
