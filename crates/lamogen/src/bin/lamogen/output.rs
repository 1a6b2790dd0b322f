//! Files to write: the format by the end of the name, or named.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::ValueEnum;
use lamogen::files::bvh::{BvhNames, BvhOptions};
use lamogen::files::glb::GlbOptions;
use lamogen::files::{WriteOptions, csv};
use lamogen_view::{GifOptions, gif, png, save, sheet};

use crate::arguments::{BvhNamesName, WritingArguments};
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::report;
use crate::scene::{Scene, Shown, seconds};

/// A format of files that the command writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    Glb,
    Bvh,
    Npy,
    #[value(name = "features.npy")]
    Features,
    Csv,
    Svg,
    Png,
    Gif,
    Html,
    Json,
}

/// A file to write.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    pub path: PathBuf,
    pub format: Format,
}

/// Frames of a GIF of which it is said that they are many: a minute and more.
const MANY_FRAMES: usize = 1200;

/// Poses on a strip, and pixels for each unit of its picture.
const POSES: usize = 10;
const PIXELS: f32 = 1.5;

impl Format {
    /// How names of such files end, without the first dot.
    pub fn ending(self) -> &'static str {
        match self {
            Format::Glb => "glb",
            Format::Bvh => "bvh",
            Format::Npy => "npy",
            Format::Features => "features.npy",
            Format::Csv => "csv",
            Format::Svg => "svg",
            Format::Png => "png",
            Format::Gif => "gif",
            Format::Html => "html",
            Format::Json => "json",
        }
    }
}

impl FromStr for Output {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let lower = name.to_lowercase();
        let fits = |format: &Format| lower.ends_with(&format!(".{}", format.ending()));
        // The longest ending: features.npy before npy.
        let formats = Format::value_variants().iter().copied().filter(fits);
        let format = formats.max_by_key(|format| format.ending().len());
        // A name is more than its ending.
        let format = format.filter(|format| {
            let rest = &lower[..lower.len() - format.ending().len() - 1];
            !rest.is_empty() && !rest.ends_with(['/', std::path::MAIN_SEPARATOR])
        });
        let format = format.ok_or_else(|| {
            let known = Format::value_variants().iter();
            let known: Vec<String> = known
                .map(|format| format!(".{}", format.ending()))
                .collect();
            format!("expected a name that ends in {}", known.join(", "))
        })?;
        Ok(Output {
            path: name.into(),
            format,
        })
    }
}

impl fmt::Display for Output {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.path.display().fmt(f)
    }
}

impl Output {
    /// The same file for one of several samples: `jump.glb` becomes `jump-7.glb`.
    pub fn numbered(&self, number: u64) -> Output {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let stem = name.len() - self.format.ending().len() - 1;
        let name = format!("{}-{number}{}", &name[..stem], &name[stem..]);
        Output {
            path: self.path.with_file_name(name),
            format: self.format,
        }
    }

    /// Whether the folder is there and takes files. This should be known before the work, not after.
    pub fn check(&self) -> Result<(), Failure> {
        let folder = match self.path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        if self.path.is_dir() {
            return Err(Failure::output(
                &self.path,
                "expected a file, found a folder",
            ));
        }
        match tempfile::tempfile_in(folder) {
            Ok(_) => Ok(()),
            Err(error) if !folder.exists() => {
                let hint = format!("mkdir -p {}", folder.display());
                Err(Failure::output(&self.path, error).hint(hint))
            }
            Err(error) => Err(Failure::output(&self.path, error)),
        }
    }

    /// Writes what a scene has for this format, whole or not at all.
    pub fn write(
        &self,
        scene: &Scene,
        writing: &WritingArguments,
        console: &Console,
    ) -> Result<(), Failure> {
        let path = &self.path;
        match self.format {
            Format::Glb | Format::Bvh | Format::Npy | Format::Features => {
                let options = options(scene, writing, self.format);
                let shown = scene.main();
                lamogen::files::write(path, &shown.motion, &options)?;
                if matches!(self.format, Format::Glb | Format::Bvh)
                    && !scene.main().motion.is_rigid()
                    && !console.is_quiet()
                {
                    console.notice(format!("{self}: {}", rigid(shown)));
                }
                return Ok(());
            }
            Format::Csv => {
                csv::write_laban(path, &scene.series())
                    .map_err(|error| Failure::new(Code::Output, error))?;
                return Ok(());
            }
            _ => {}
        }
        let drawn = |error: &dyn fmt::Display| Failure::output(path, error);
        let sheet = || {
            sheet(&scene.heading(), &scene.rows(), POSES, &scene.curves())
                .map_err(|error| drawn(&error))
        };
        let content = match self.format {
            Format::Svg => sheet()?.into_bytes(),
            Format::Png => png(&sheet()?, PIXELS).map_err(|error| drawn(&error))?,
            Format::Gif => {
                let frames = scene.main().motion.frames();
                if frames > MANY_FRAMES {
                    console.notice(format!(
                        "{self}: a GIF of {frames} frames takes long to draw and has tens of megabytes; .html plays a motion of any length"
                    ));
                }
                let bar = console.bar("frames");
                let options = GifOptions {
                    width: writing.gif_width,
                };
                let bytes = gif(&scene.rows(), &options, &mut |done, all| {
                    bar.set_length(all as u64);
                    bar.set_position(done as u64);
                });
                bar.finish_and_clear();
                bytes.map_err(|error| drawn(&error))?
            }
            Format::Html => scene.page().into_bytes(),
            _ => report::everything(scene).to_string().into_bytes(),
        };
        save(path, &content).map_err(|error| Failure::new(Code::Output, error))
    }
}

fn options(scene: &Scene, writing: &WritingArguments, format: Format) -> WriteOptions {
    let mut options = WriteOptions {
        bvh: BvhOptions {
            unit: writing.bvh_unit,
            names: match writing.bvh_names {
                BvhNamesName::HumanMl3d => BvhNames::HumanMl3d,
                BvhNamesName::Mixamo => BvhNames::Mixamo,
            },
        },
        glb: GlbOptions {
            name: scene.title.clone(),
            copyright: scene.copyright.clone(),
            notes: scene.glb_notes(),
            ..GlbOptions::default()
        },
        ..WriteOptions::default()
    };
    // Arrays have the frames that the motion has.
    if matches!(format, Format::Glb | Format::Bvh) {
        options.frames_per_second = writing.fps;
    }
    options
}

/// How far a rig is from a motion whose bones change their length.
fn rigid(shown: &Shown) -> String {
    let distance = shown.rotations().distance(&shown.motion);
    format!(
        "bones keep their length, so joints are {:.1} mm from the motion's on average, {:.0} mm at most ({}, {:.2} s)",
        1e3 * distance.mean,
        1e3 * distance.largest,
        distance.joint.name(),
        seconds(distance.frame)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_says_the_format() {
        for (name, format) in [
            ("a.glb", Format::Glb),
            ("b/a.BVH", Format::Bvh),
            ("a.npy", Format::Npy),
            ("a.features.npy", Format::Features),
            ("a.b.json", Format::Json),
        ] {
            assert_eq!(name.parse::<Output>().unwrap().format, format);
        }
        for name in ["a.fbx", "glb", "", "a.", ".glb", "b/.json"] {
            let message = name.parse::<Output>().unwrap_err();
            assert!(message.contains(".glb, .bvh"), "{message}");
        }
    }

    #[test]
    fn samples_are_named_by_their_seed() {
        let name = |name: &str| name.parse::<Output>().unwrap().numbered(7).path;
        assert_eq!(name("b/jump.glb"), Path::new("b/jump-7.glb"));
        assert_eq!(name("jump.Features.npy"), Path::new("jump-7.Features.npy"));
    }
}
