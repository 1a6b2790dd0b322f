// What is wished: the content of the fields, as JSON for the server, and in the fragment of the address.

const LOWEST = 0.2;
const HIGHEST = 2;
const EFFORTS = 3;

/** Returns a wish without factors. */
function newWish(components) {
  return {
    prompt: "a person jumps",
    seconds: 4,
    seed: 1,
    loop: false,
    factors: components.map(() => 1),
    /** For each component the keys of its factor over time: [{ time, factor }]; none where the factor is one number. */
    keys: components.map(() => []),
    /** For each component, whether its factor slides from key to key. */
    slides: components.map(() => true),
    /** [{ part, factors }] with factors of Weight, Time and Flow. */
    parts: [],
    /** { name, series } of a motion to be like, or null. */
    like: null,
  };
}

const copyWish = (wish) => structuredClone(wish);
const isSame = (one, other) => JSON.stringify(one) === JSON.stringify(other);
const number = (value) => Number(value.toFixed(3));

/** Returns the factor of a component as the server reads it: a number, keys over time, or null for none. */
function factorText(wish, c) {
  const keys = wish.keys[c];
  if (keys.length === 0) return wish.factors[c] === 1 ? null : number(wish.factors[c]);
  const texts = keys.map(({ time, factor }) => `${number(time)}:${number(factor)}`);
  return texts.join(wish.slides[c] ? " ~ " : " ");
}

/** Returns the words of a part as the server reads them, or null if it asks for nothing. */
function partText({ part, factors }, components) {
  const words = factors.map((factor, c) => (factor === 1 ? null : `${components[c].key}=${number(factor)}`)).filter(Boolean);
  return words.length === 0 ? null : `${part}:${words.join(",")}`;
}

/** Returns the request of a wish. */
function toRequest(wish, components) {
  const request = { prompt: wish.prompt, seconds: wish.seconds, seed: wish.seed };
  if (wish.loop) request.loop = true;
  components.forEach(({ key }, c) => {
    const text = factorText(wish, c);
    if (text !== null) request[key] = text;
  });
  const parts = wish.parts.map((part) => partText(part, components)).filter(Boolean);
  if (parts.length > 0) request.part = parts;
  if (wish.like) {
    request.like = wish.like.series;
    // The server measures parts beside a motion to be like only if Weight, Time and Flow have factors of their own.
    if (parts.length > 0) components.slice(0, EFFORTS).forEach(({ key }) => (request[key] ??= 1));
  }
  return request;
}

/** Describes a wish in a few words. */
function describeWish(wish, components) {
  const words = components.map(({ name }, c) => {
    const text = factorText(wish, c);
    return text === null ? null : wish.keys[c].length ? `${name} over time` : `${name} ${text}`;
  });
  const parts = wish.parts.map((part) => partText(part, components));
  const like = wish.like ? `like ${wish.like.name}` : null;
  return [`“${wish.prompt}”`, `${wish.seconds} s`, `seed ${wish.seed}`, wish.loop ? "loop" : null, ...words, ...parts, like].filter(Boolean).join(", ");
}

/** Encodes 32-bit floats for an address. */
function encodeSeries(series, components) {
  const values = Float32Array.from(components.flatMap(({ key }) => series[key]));
  const letters = Array.from(new Uint8Array(values.buffer), (byte) => String.fromCharCode(byte)).join("");
  return btoa(letters).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

function decodeSeries(text, components) {
  const values = Array.from(decodeFloats(text.replaceAll("-", "+").replaceAll("_", "/")));
  const frames = values.length / components.length;
  return Object.fromEntries(components.map(({ key }, c) => [key, values.slice(c * frames, (c + 1) * frames)]));
}

/** Returns the fragment of the address that gives a wish again. */
function toFragment(wish, components) {
  const { prompt, seconds, seed, loop, part = [], ...rest } = toRequest({ ...wish, like: null }, components);
  const fields = new URLSearchParams({ prompt, seconds, seed });
  if (loop) fields.set("loop", "1");
  for (const [key, value] of Object.entries(rest)) fields.set(key, value);
  for (const text of part) fields.append("part", text);
  if (wish.like) {
    fields.set("like", wish.like.name);
    fields.set("series", encodeSeries(wish.like.series, components));
  }
  return `#${fields}`;
}

/** Reads a fragment. Fields that are not there or not valid are those of a new wish. */
function fromFragment(fragment, components) {
  const fields = new URLSearchParams(fragment.replace(/^#/, ""));
  const wish = newWish(components);
  const read = (name, isValid, fallback) => {
    const value = Number(fields.get(name));
    return fields.has(name) && Number.isFinite(value) && isValid(value) ? value : fallback;
  };
  const inRange = (factor) => Math.min(Math.max(factor, LOWEST), HIGHEST);
  wish.prompt = fields.get("prompt") ?? wish.prompt;
  wish.seconds = read("seconds", (seconds) => seconds > 0, wish.seconds);
  wish.seed = read("seed", (seed) => Number.isSafeInteger(seed) && seed >= 0, wish.seed);
  wish.loop = fields.get("loop") === "1";
  components.forEach(({ key, words }, c) => {
    const text = fields.get(key) ?? "";
    const word = words.find(({ word }) => word === text);
    if (text.includes(":")) {
      wish.slides[c] = text.includes("~");
      const keys = text.split(/[\s~]+/).map((key) => key.split(":").map(Number));
      wish.keys[c] = keys.filter((key) => key.length === 2 && key.every(Number.isFinite)).map(([time, factor]) => ({ time, factor: inRange(factor) }));
    } else if (text !== "") {
      const factor = word ? word.factor : Number(text);
      if (Number.isFinite(factor)) wish.factors[c] = inRange(factor);
    }
  });
  for (const text of fields.getAll("part")) {
    const [part, words = ""] = text.split(":");
    if (!PARTS.includes(part)) continue;
    const factors = components.slice(0, EFFORTS).map(({ key }) => {
      const value = Number(words.split(",").find((word) => word.startsWith(`${key}=`))?.slice(key.length + 1) ?? 1);
      return Number.isFinite(value) ? inRange(value) : 1;
    });
    wish.parts.push({ part, factors });
  }
  if (fields.has("series")) {
    try {
      wish.like = { name: fields.get("like") ?? "a motion", series: decodeSeries(fields.get("series"), components) };
    } catch {
      wish.like = null;
    }
  }
  return wish;
}

/** The parts of the body that can have factors of their own. */
const PARTS = ["arms", "left-arm", "right-arm", "legs", "left-leg", "right-leg", "head", "torso"];
