//! The palette of an animation, which has few enough colours for GIF and is fixed before the first frame.

use std::collections::HashMap;

use lamogen_view::FIGURE_COLOURS;

/// The grey of the darkest letters, and a middle grey. One ramp leads from the first to the second, another one to white.
const GREYS: [&str; 2] = ["#111827", "#6b7280"];
/// The number of greys from the middle grey to white.
const GREY_STEPS: usize = 40;
/// The number of colours from the colour of a limb to white, for antialiased edges.
const LIMB_STEPS: usize = 16;
/// The numbers of levels of red, green and blue for all other colours, such as those of emoji in a label.
const OTHERS: [usize; 3] = [4, 5, 4];

/// The palette of all frames. A colour has the same index in every frame, so nothing flickers.
pub(crate) struct Palette {
    colours: Vec<[u8; 3]>,
    /// The nearest index of each colour that has been looked up so far.
    cache: HashMap<[u8; 3], u8>,
}

impl Palette {
    /// The index of transparent pixels, which keep the colour of the previous frame.
    pub const TRANSPARENT: u8 = 0;

    /// Creates a palette with the colours of figures, letters and ground, each with a ramp to white.
    pub fn new() -> Palette {
        let white = [255; 3];
        // The first entry belongs to the index of transparency.
        let mut colours = vec![white, white];
        let [dark, middle] = GREYS.map(rgb);
        let mut ramp = |from: [u8; 3], to: [u8; 3], steps: usize| {
            let mix = |step: usize, axis: usize| {
                let (from, to) = (f32::from(from[axis]), f32::from(to[axis]));
                (from + (to - from) * step as f32 / steps as f32).round() as u8
            };
            colours.extend((0..steps).map(|step| std::array::from_fn(|axis| mix(step, axis))));
        };
        ramp(dark, middle, GREY_STEPS / 4);
        ramp(middle, white, GREY_STEPS);
        for colour in FIGURE_COLOURS {
            ramp(rgb(colour), white, LIMB_STEPS);
        }
        let level = |step: usize, steps: usize| (255 * step / (steps - 1)) as u8;
        let [reds, greens, blues] = OTHERS;
        for index in 0..reds * greens * blues {
            let (red, green, blue) = (
                index / (greens * blues),
                index / blues % greens,
                index % blues,
            );
            colours.push([level(red, reds), level(green, greens), level(blue, blues)]);
        }
        Palette {
            colours,
            cache: HashMap::new(),
        }
    }

    /// Returns red, green and blue of every index.
    pub fn bytes(&self) -> &[u8] {
        self.colours.as_flattened()
    }

    /// Returns the index of the nearest colour of the palette.
    pub fn index(&mut self, colour: [u8; 3]) -> u8 {
        let colours = &self.colours;
        *self.cache.entry(colour).or_insert_with(|| {
            let distance = |other: &[u8; 3]| -> i32 {
                let differences = colour.iter().zip(other);
                differences
                    .map(|(&a, &b)| (i32::from(a) - i32::from(b)).pow(2))
                    .sum()
            };
            let opaque = usize::from(Self::TRANSPARENT) + 1..colours.len();
            let nearest = opaque.min_by_key(|&index| distance(&colours[index]));
            nearest.expect("there are colours") as u8
        })
    }
}

/// Parses a colour such as `#c2410c` as red, green and blue.
fn rgb(colour: &str) -> [u8; 3] {
    let number = u32::from_str_radix(&colour[1..], 16).expect("six digits after the #");
    let [_, red, green, blue] = number.to_be_bytes();
    [red, green, blue]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_small_enough_for_gif() {
        let palette = Palette::new();
        assert!(palette.colours.len() <= 256, "{}", palette.colours.len());
        assert_eq!(palette.bytes().len(), 3 * palette.colours.len());
    }

    #[test]
    fn the_colours_of_the_picture_are_exact_and_never_transparent() {
        let mut palette = Palette::new();
        for colour in FIGURE_COLOURS
            .into_iter()
            .chain(GREYS)
            .chain(["#ffffff", "#000000"])
        {
            let index = palette.index(rgb(colour));
            assert_eq!(palette.colours[usize::from(index)], rgb(colour));
            assert_ne!(index, Palette::TRANSPARENT);
        }
    }

    #[test]
    fn any_colour_has_one_near_it() {
        let mut palette = Palette::new();
        for red in (0..=255).step_by(15) {
            for green in (0..=255).step_by(15) {
                for blue in (0..=255).step_by(15) {
                    let index = palette.index([red, green, blue]);
                    let near = palette.colours[usize::from(index)];
                    let apart = |a: u8, b: u8| u32::from(a.abs_diff(b)).pow(2);
                    let squared =
                        apart(red, near[0]) + apart(green, near[1]) + apart(blue, near[2]);
                    assert!(squared < 80 * 80, "{red} {green} {blue}: {near:?}");
                }
            }
        }
    }
}
