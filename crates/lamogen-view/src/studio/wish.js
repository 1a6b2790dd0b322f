// What is wished: the content of the fields, as JSON for the server, and in the fragment of the address.

const LOWEST = 0.2;
const HIGHEST = 2;
const EFFORTS = 3;
/** The largest turn of the body on its path, in degrees. */
const MOST_DEGREES = 360;

/** The length of the longest sentence in seconds. */
const LONGEST_SENTENCE = 60;

/** Returns a sentence without factors. */
function newSentence(components, prompt = "a person jumps", seconds = 4) {
  return {
    prompt,
    seconds,
    factors: components.map(() => 1),
    /** For each component the keys of its factor over time: [{ time, factor }]; none where the factor is one number. */
    keys: components.map(() => []),
    /** For each component, whether its factor slides from key to key. */
    slides: components.map(() => true),
    /** [{ part, factors }] with factors of Weight, Time and Flow. */
    parts: [],
  };
}

/** Returns a wish of one sentence without factors. */
function newWish(components) {
  return {
    seed: 1,
    loop: false,
    /** What comes one after another. Times of keys count from the beginning of their sentence. */
    sentences: [newSentence(components)],
    /** { name, series } of a motion that the first sentence shall be like, or null. */
    like: null,
    /** Places on the floor in the order of time: [{ time, x, z }], x to the left of how the body stands at the start, z forward. */
    path: [],
    /** Where the body faces on its path: "path" (along it), "free", or degrees to the left of the start. */
    face: "path",
    /** Positions of parts of the body: [{ part, time, x, y, z }], x and z as in the path, y up from the floor. */
    reaches: [],
  };
}

const copyWish = (wish) => structuredClone(wish);
const isSame = (one, other) => JSON.stringify(one) === JSON.stringify(other);
const number = (value) => Number(value.toFixed(3));

/** Returns the length of the whole motion in seconds. */
const totalSeconds = (wish) => wish.sentences.reduce((sum, { seconds }) => sum + seconds, 0);

/** Returns the moment at which a sentence begins, in seconds. */
const beginning = (wish, i) => wish.sentences.slice(0, i).reduce((sum, { seconds }) => sum + seconds, 0);

/** Returns whether a motion can be a loop: one sentence that goes its own way. */
const canLoop = (wish) => wish.sentences.length === 1 && wish.path.length === 0;

/** Removes what is past an end: keys of sentences, places, positions. */
function prune(wish) {
  for (const sentence of wish.sentences) {
    sentence.keys = sentence.keys.map((keys) => keys.filter(({ time }) => time < sentence.seconds - KEY_STEP / 2));
  }
  const total = totalSeconds(wish) + 1e-6;
  wish.path = wish.path.filter(({ time }) => time <= total);
  wish.reaches = wish.reaches.filter(({ time }) => time <= total);
  if (!canLoop(wish)) wish.loop = false;
  return wish;
}

/** Returns the factor of a component as the server reads it: a number, keys over time, or null for none. */
function factorText(sentence, c) {
  const keys = sentence.keys[c];
  if (keys.length === 0) return sentence.factors[c] === 1 ? null : number(sentence.factors[c]);
  const texts = keys.map(({ time, factor }) => `${number(time)}:${number(factor)}`);
  return texts.join(sentence.slides[c] ? " ~ " : " ");
}

/** Returns the words of a part as the server reads them, or null if it asks for nothing. */
function partText({ part, factors }, components) {
  const words = factors.map((factor, c) => (factor === 1 ? null : `${components[c].key}=${number(factor)}`)).filter(Boolean);
  return words.length === 0 ? null : `${part}:${words.join(",")}`;
}

/** Returns places as the server reads them. */
const pathText = (path) => path.map(({ time, x, z }) => `${number(time)}:${number(x)},${number(z)}`).join(" ");

/** Returns a position of a part of the body as the server reads it. */
const reachText = ({ part, time, x, y, z }) => `${part}@${number(time)}=${number(x)},${number(y)},${number(z)}`;

/** Reads where the body faces: "path", "free" or degrees. */
function readFace(text) {
  if (text === "free") return "free";
  const degrees = text === null || text.trim() === "" ? NaN : Number(text);
  return Math.abs(degrees) <= MOST_DEGREES ? degrees : "path";
}

/** Reads positions of parts of the body; those that are not valid are left out. */
function readReaches(texts) {
  const reaches = [];
  for (const text of texts) {
    const [part, rest = ""] = text.split("@");
    const [time, x, y, z, ...more] = rest.split(/[=,]/).map((value) => (value.trim() === "" ? NaN : Number(value)));
    const isTaken = reaches.some((other) => other.part === part && Math.abs(other.time - time) < KEY_STEP / 2);
    if (Object.hasOwn(REACH_PARTS, part) && time >= 0 && [x, y, z].every(Number.isFinite) && more.length === 0 && !isTaken && reaches.length < MOST_REACHES) reaches.push({ part, time, x, y, z });
  }
  return reaches;
}

/** Returns the fields of a sentence in a request. */
function sentenceRequest(sentence, components) {
  const request = { prompt: sentence.prompt, seconds: number(sentence.seconds) };
  components.forEach(({ key }, c) => {
    const text = factorText(sentence, c);
    if (text !== null) request[key] = text;
  });
  const parts = sentence.parts.map((part) => partText(part, components)).filter(Boolean);
  if (parts.length > 0) request.part = parts;
  return request;
}

/** Returns the request of a wish. */
function toRequest(wish, components) {
  const { sentences, seed, loop, like, path, face, reaches } = prune(copyWish(wish));
  const [first, ...others] = sentences.map((sentence) => sentenceRequest(sentence, components));
  const request = { ...first, seed };
  if (loop) request.loop = true;
  if (like) {
    request.like = like.series;
    // The server measures parts beside a motion to be like only if Weight, Time and Flow have factors of their own.
    if (request.part) components.slice(0, EFFORTS).forEach(({ key }) => (request[key] ??= 1));
  }
  if (others.length > 0) request.then = others;
  if (path.length > 0) {
    request.path = pathText(path);
    if (face !== "path") request.face = face;
  }
  if (reaches.length > 0) request.reach = reaches.map(reachText);
  return request;
}

/** Describes a wish in a few words. */
function describeWish(wish, components) {
  const sentences = wish.sentences.map((sentence) => {
    const words = components.map(({ name }, c) => {
      const text = factorText(sentence, c);
      return text === null ? null : sentence.keys[c].length ? `${name} over time` : `${name} ${text}`;
    });
    const parts = sentence.parts.map((part) => partText(part, components));
    return [`“${sentence.prompt}”`, `${number(sentence.seconds)} s`, ...words, ...parts].filter(Boolean).join(", ");
  });
  const places = wish.path.length ? `${wish.path.length} ${wish.path.length === 1 ? "place" : "places"}` : null;
  const reached = wish.reaches.length ? `${wish.reaches.length} ${wish.reaches.length === 1 ? "position" : "positions"}` : null;
  const like = wish.like ? `like ${wish.like.name}` : null;
  return [sentences.join("; then "), `seed ${wish.seed}`, wish.loop ? "loop" : null, like, places, reached].filter(Boolean).join(", ");
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

/** Writes a sentence into fields of an address. */
function sentenceFields(sentence, components) {
  const { part = [], ...rest } = sentenceRequest(sentence, components);
  const fields = new URLSearchParams(rest);
  for (const text of part) fields.append("part", text);
  return fields;
}

/** Returns the fragment of the address that gives a wish again. A further sentence is a field with fields of its own. */
function toFragment(wish, components) {
  const { sentences, seed, loop, like, path, face, reaches } = wish;
  const [fields, ...others] = sentences.map((sentence) => sentenceFields(sentence, components));
  fields.set("seed", seed);
  if (loop) fields.set("loop", "1");
  for (const other of others) fields.append("then", String(other));
  if (path.length > 0) fields.set("path", pathText(path));
  if (path.length > 0 && face !== "path") fields.set("face", face);
  for (const reach of reaches) fields.append("reach", reachText(reach));
  if (like) {
    fields.set("like", like.name);
    fields.set("series", encodeSeries(like.series, components));
  }
  return `#${fields}`;
}

/** Reads a number of an address. */
function readNumber(fields, name, isValid, fallback) {
  const value = Number(fields.get(name));
  return fields.has(name) && Number.isFinite(value) && isValid(value) ? value : fallback;
}

/** Reads a sentence from fields of an address. */
function readSentence(fields, components) {
  const sentence = newSentence(components);
  const inRange = (factor) => Math.min(Math.max(factor, LOWEST), HIGHEST);
  sentence.prompt = fields.get("prompt") ?? sentence.prompt;
  sentence.seconds = readNumber(fields, "seconds", (seconds) => seconds > 0 && seconds <= LONGEST_SENTENCE, sentence.seconds);
  components.forEach(({ key, words }, c) => {
    const text = fields.get(key) ?? "";
    const word = words.find(({ word }) => word === text);
    if (text.includes(":")) {
      sentence.slides[c] = text.includes("~");
      const keys = text.split(/[\s~]+/).map((key) => key.split(":").map(Number));
      sentence.keys[c] = keys.filter((key) => key.length === 2 && key.every(Number.isFinite)).map(([time, factor]) => ({ time, factor: inRange(factor) }));
    } else if (text !== "") {
      const factor = word ? word.factor : Number(text);
      if (Number.isFinite(factor)) sentence.factors[c] = inRange(factor);
    }
  });
  for (const text of fields.getAll("part")) {
    const [part, words = ""] = text.split(":");
    if (!PARTS.includes(part)) continue;
    const factors = components.slice(0, EFFORTS).map(({ key }) => {
      const value = Number(words.split(",").find((word) => word.startsWith(`${key}=`))?.slice(key.length + 1) ?? 1);
      return Number.isFinite(value) ? inRange(value) : 1;
    });
    sentence.parts.push({ part, factors });
  }
  return sentence;
}

/** Reads a fragment. Fields that are not there or not valid are those of a new wish. */
function fromFragment(fragment, components) {
  const fields = new URLSearchParams(fragment.replace(/^#/, ""));
  const wish = newWish(components);
  const others = fields.getAll("then").map((text) => new URLSearchParams(text));
  wish.sentences = [fields, ...others].map((sentence) => readSentence(sentence, components));
  wish.seed = readNumber(fields, "seed", (seed) => Number.isSafeInteger(seed) && seed >= 0, wish.seed);
  wish.loop = fields.get("loop") === "1";
  for (const text of (fields.get("path") ?? "").split(/\s+/)) {
    const [time, x, z, ...more] = text.split(/[:,]/).map(Number);
    const isLater = time > (wish.path.at(-1)?.time ?? 0);
    if (more.length === 0 && isLater && Number.isFinite(x) && Number.isFinite(z)) wish.path.push({ time, x, z });
  }
  wish.face = readFace(fields.get("face"));
  wish.reaches = readReaches(fields.getAll("reach"));
  if (fields.has("series")) {
    try {
      wish.like = { name: fields.get("like") ?? "a motion", series: decodeSeries(fields.get("series"), components) };
    } catch {
      wish.like = null;
    }
  }
  return prune(wish);
}

/** The parts of the body that can have factors of their own. */
const PARTS = ["arms", "left-arm", "right-arm", "legs", "left-leg", "right-leg", "head", "torso"];
