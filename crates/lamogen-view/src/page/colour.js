// Colours: [red, green, blue], 0 to 255.

const css = ([red, green, blue], alpha = 1) => `rgba(${Math.round(red)},${Math.round(green)},${Math.round(blue)},${alpha})`;
const WHITE = [255, 255, 255];
const BLACK = [0, 0, 0];

/** Brightness as the eye sees it, 0 to 1. */
function luminance(colour) {
  const [red, green, blue] = colour.map((x) => (x / 255) ** 2.2);
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
}

/** The colour, brighter on a dark page or darker on a light one where it would be hard to see. */
function readable(colour, dark) {
  let found = colour;
  for (let i = 0; i < 30 && (dark ? luminance(found) < 0.24 : luminance(found) > 0.5); i++) {
    found = mix(found, dark ? WHITE : BLACK, 0.06);
  }
  return found;
}

/** A surface's colour under so much light: 1 is its own. */
function lit(colour, light) {
  return light <= 1 ? times(colour, light) : mix(colour, WHITE, Math.min(light - 1, 1));
}
