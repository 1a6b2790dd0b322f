//! Output files; their format follows from the end of their names.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::ValueEnum;
use lamogen::character::{Character, RetargetOptions, SaveOptions};
use lamogen::files::bvh::{BvhNames, BvhOptions};
use lamogen::files::glb::GlbOptions;
use lamogen::files::vrma::VrmaOptions;
use lamogen::files::{WriteOptions, csv};
use lamogen_raster::{GifOptions, gif, png};
use lamogen_view::{save, sheet};

use crate::arguments::{BvhNaming, HandsName, WritingArguments};
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::report;
use crate::scene::{Scene, SceneMotion, seconds};

/// A format of files that the command writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OutputFormat {
    Glb,
    Bvh,
    Vrma,
    Npy,
    #[value(name = "features.npy")]
    Features,
    Csv,
    Svg,
    Png,
    Gif,
    Html,
    Json,
    /// A character in the container of VRM.
    Vrm,
    /// A character as JSON.
    Gltf,
}

/// A file to write.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputFile {
    pub path: PathBuf,
    pub format: OutputFormat,
}

/// GIFs with more frames than this (a minute) come with a notice.
const MANY_FRAMES: usize = 1200;

/// The number of poses on a strip.
const POSES: usize = 10;
/// The number of pixels for each unit of a picture.
const PIXELS: f32 = 1.5;

impl OutputFormat {
    /// The formats in which the travel of a motion may be in several places.
    pub const WITH_TRAVEL: [OutputFormat; 6] = [
        OutputFormat::Glb,
        OutputFormat::Vrma,
        OutputFormat::Gltf,
        OutputFormat::Vrm,
        OutputFormat::Bvh,
        OutputFormat::Npy,
    ];

    /// Returns whether files of this format hold a character: a BVH the skeleton of a BVH, glTF other characters.
    pub fn holds(self, character: &Character) -> bool {
        match self {
            OutputFormat::Bvh => character.is_bvh(),
            OutputFormat::Glb | OutputFormat::Gltf | OutputFormat::Vrm => !character.is_bvh(),
            _ => false,
        }
    }

    /// Returns the file name extension of the format, without the first dot.
    pub fn ending(self) -> &'static str {
        match self {
            OutputFormat::Glb => "glb",
            OutputFormat::Vrm => "vrm",
            OutputFormat::Gltf => "gltf",
            OutputFormat::Bvh => "bvh",
            OutputFormat::Vrma => "vrma",
            OutputFormat::Npy => "npy",
            OutputFormat::Features => "features.npy",
            OutputFormat::Csv => "csv",
            OutputFormat::Svg => "svg",
            OutputFormat::Png => "png",
            OutputFormat::Gif => "gif",
            OutputFormat::Html => "html",
            OutputFormat::Json => "json",
        }
    }

    /// Returns whether files of this format hold the motion as rotations of a rigid body.
    fn has_rotations(self) -> bool {
        matches!(
            self,
            OutputFormat::Glb | OutputFormat::Bvh | OutputFormat::Vrma
        )
    }
}

impl FromStr for OutputFile {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let lower = name.to_lowercase();
        let fits = |format: &OutputFormat| lower.ends_with(&format!(".{}", format.ending()));
        // The longest ending counts: features.npy before npy.
        let formats = OutputFormat::value_variants().iter().copied().filter(fits);
        let format = formats.max_by_key(|format| format.ending().len());
        // There must be a name before the ending.
        let format = format.filter(|format| {
            let stem = &lower[..lower.len() - format.ending().len() - 1];
            !stem.is_empty() && !stem.ends_with(['/', std::path::MAIN_SEPARATOR])
        });
        let format = format.ok_or_else(|| {
            let known = OutputFormat::value_variants().iter();
            let known: Vec<String> = known
                .map(|format| format!(".{}", format.ending()))
                .collect();
            format!("expected a name that ends in {}", known.join(", "))
        })?;
        Ok(OutputFile {
            path: name.into(),
            format,
        })
    }
}

impl fmt::Display for OutputFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.path.display().fmt(f)
    }
}

impl OutputFile {
    /// Returns the file of one of several samples: `jump.glb` becomes `jump-7.glb`.
    pub fn numbered(&self, number: u64) -> OutputFile {
        self.with_suffix(&number.to_string())
    }

    /// What [`unfinished`](Self::unfinished) adds to a name.
    pub const UNFINISHED: &str = "unfinished";

    /// Returns the file of a motion of which only the first part is finished: `jump.glb` becomes `jump-unfinished.glb`.
    pub fn unfinished(&self) -> OutputFile {
        self.with_suffix(Self::UNFINISHED)
    }

    /// Returns the file with a suffix to its name, before the ending.
    fn with_suffix(&self, suffix: &str) -> OutputFile {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let stem = name.len() - self.format.ending().len() - 1;
        let name = format!("{}-{suffix}{}", &name[..stem], &name[stem..]);
        OutputFile {
            path: self.path.with_file_name(name),
            format: self.format,
        }
    }

    /// Checks whether the folder exists and files can be written to it. Commands call this before their work, so that
    /// no work is lost.
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

    /// Writes a scene in this format. An error leaves no incomplete file.
    pub fn write(
        &self,
        scene: &Scene,
        writing: &WritingArguments,
        console: &Console,
    ) -> Result<(), Failure> {
        let path = &self.path;
        match self.format {
            format
                if let Some(character) = writing.onto.open()?
                    && format.holds(character) =>
            {
                return self.write_onto(character, scene, writing);
            }
            format
                if format.has_rotations()
                    && !scene.main().motion.is_rigid()
                    && !console.is_quiet() =>
            {
                console.notice(format!("{self}: {}", rigid_body_notice(scene.main())));
            }
            OutputFormat::Gif if scene.main().motion.frames() > MANY_FRAMES => {
                let frames = scene.main().motion.frames();
                console.notice(format!(
                    "{self}: a GIF of {frames} frames takes long to draw and has tens of megabytes; .html plays a motion of any length"
                ));
            }
            _ => {}
        }
        let bytes = self.content(scene, writing, console)?;
        save(path, &bytes).map_err(|error| Failure::new(FailureCode::Output, error))
    }

    /// Returns the content of the file, without a character. Nothing is written; the path stands in errors.
    pub fn content(
        &self,
        scene: &Scene,
        writing: &WritingArguments,
        console: &Console,
    ) -> Result<Vec<u8>, Failure> {
        let path = &self.path;
        let failure = |error: &dyn fmt::Display| Failure::output(path, error);
        let sheet = || {
            sheet(&scene.heading(), &scene.rows(), POSES, &scene.curves())
                .map_err(|error| failure(&error))
        };
        Ok(match self.format {
            OutputFormat::Glb
            | OutputFormat::Bvh
            | OutputFormat::Vrma
            | OutputFormat::Npy
            | OutputFormat::Features => {
                let options = write_options(scene, writing, self.format);
                lamogen::files::write_bytes(path, &scene.main().motion, &options)?
            }
            OutputFormat::Csv => csv::laban(&scene.series(), &scene.main().captions).into_bytes(),
            OutputFormat::Svg => sheet()?.into_bytes(),
            OutputFormat::Png => png(&sheet()?, PIXELS).map_err(|error| failure(&error))?,
            OutputFormat::Gif => {
                let bar = console.progress_bar("frames");
                let options = GifOptions {
                    width: writing.gif_width,
                };
                let bytes = gif(&scene.rows(), &options, &mut |done, all| {
                    bar.set_length(all as u64);
                    bar.set_position(done as u64);
                });
                bar.finish_and_clear();
                bytes.map_err(|error| failure(&error))?
            }
            OutputFormat::Html => scene.page().into_bytes(),
            _ => report::scene_json(scene).to_string().into_bytes(),
        })
    }
}

impl OutputFile {
    /// Writes the file of a character with the motion as one more animation.
    fn write_onto(
        &self,
        character: &Character,
        scene: &Scene,
        writing: &WritingArguments,
    ) -> Result<(), Failure> {
        let mut options = RetargetOptions {
            plant_feet: !writing.onto.free_feet,
            place_hands: !writing.onto.free_hands,
            relax_hands: writing.onto.hands == HandsName::Relax,
            ..RetargetOptions::default()
        };
        if let Some(rate) = writing.fps {
            options.frames_per_second = rate;
        }
        let name = writing.onto.animation_name.as_ref();
        let animation = character
            .animate(&scene.main().motion, &options)?
            .named(name.unwrap_or(&scene.title));
        let options = SaveOptions {
            replace_animations: writing.onto.replace_animations,
        };
        Ok(character.save(&self.path, &[animation], &options)?)
    }
}

/// Returns the options of writing a motion file.
fn write_options(scene: &Scene, writing: &WritingArguments, format: OutputFormat) -> WriteOptions {
    let mut options = WriteOptions {
        bvh: BvhOptions {
            unit: writing.bvh_unit,
            names: match writing.bvh_names {
                BvhNaming::HumanMl3d => BvhNames::HumanMl3d,
                BvhNaming::Mixamo => BvhNames::Mixamo,
            },
        },
        glb: GlbOptions {
            name: scene.title.clone(),
            notes: scene.glb_notes(),
            ..GlbOptions::default()
        },
        vrma: VrmaOptions {
            name: scene.title.clone(),
            notes: scene.glb_notes(),
            ..VrmaOptions::default()
        },
        ..WriteOptions::default()
    };
    // Pose features have one frame rate.
    if format != OutputFormat::Features {
        options.frames_per_second = writing.fps;
    }
    options
}

/// Describes how far the joints of a rigid body are from those of a motion with bones of changing length.
fn rigid_body_notice(scene_motion: &SceneMotion) -> String {
    let distance = scene_motion.rotations().distance(&scene_motion.motion);
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
    fn the_ending_determines_the_format() {
        for (name, format) in [
            ("a.glb", OutputFormat::Glb),
            ("b/a.BVH", OutputFormat::Bvh),
            ("a.vrma", OutputFormat::Vrma),
            ("a.vrm", OutputFormat::Vrm),
            ("a.npy", OutputFormat::Npy),
            ("a.features.npy", OutputFormat::Features),
            ("a.b.json", OutputFormat::Json),
        ] {
            assert_eq!(name.parse::<OutputFile>().unwrap().format, format);
        }
        for name in ["a.fbx", "glb", "", "a.", ".glb", "b/.json"] {
            let message = name.parse::<OutputFile>().unwrap_err();
            assert!(message.contains(".glb, .bvh, .vrma"), "{message}");
        }
    }

    #[test]
    fn samples_are_named_by_their_seed() {
        let name = |name: &str| name.parse::<OutputFile>().unwrap().numbered(7).path;
        assert_eq!(name("b/jump.glb"), Path::new("b/jump-7.glb"));
        assert_eq!(name("jump.Features.npy"), Path::new("jump-7.Features.npy"));
        let unfinished = "b/jump.glb".parse::<OutputFile>().unwrap().unfinished();
        assert_eq!(unfinished.path, Path::new("b/jump-unfinished.glb"));
    }
}
