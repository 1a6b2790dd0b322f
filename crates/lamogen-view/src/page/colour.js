// Colours as [red, green, blue], each from 0 to 255.

const css = ([red, green, blue], alpha = 1) => `rgba(${Math.round(red)},${Math.round(green)},${Math.round(blue)},${alpha})`;
const WHITE = [255, 255, 255];
const BLACK = [0, 0, 0];

/** Returns the relative luminance of a colour, from 0 to 1. */
function luminance(colour) {
  const [red, green, blue] = colour.map((x) => (x / 255) ** 2.2);
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
}

/** Returns a colour that is brighter on a dark page, or darker on a light page, if it would be hard to see. */
function readable(colour, dark) {
  let found = colour;
  for (let i = 0; i < 30 && (dark ? luminance(found) < 0.24 : luminance(found) > 0.5); i++) {
    found = mix(found, dark ? WHITE : BLACK, 0.06);
  }
  return found;
}

/** Returns the colour of a surface under some light; under light 1 it does not change. */
function shaded(colour, light) {
  return light <= 1 ? times(colour, light) : mix(colour, WHITE, Math.min(light - 1, 1));
}
