//! The files that the judges check.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen::{Generation, LaMoGen, Request, Tag};
use lamogen_files::{ReadOptions, WriteOptions};
use lamogen_motion::{Joint, Motion, Rotations, write_atomically};
use lamogen_view::{LabanCurve, Page, PageFigure, TimedCaption};
use serde_json::json;

use super::vrm::VrmFiles;
use super::{Result, motions};

/// All files that are checked.
pub struct JudgedFiles {
    pub motions: Vec<MotionFiles>,
    /// VRM animations of the same motions, and VRM characters.
    pub vrm: VrmFiles,
    /// A page that shows a motion before and after guidance.
    pub page: PathBuf,
}

/// The files of one motion in all formats with rotations.
pub struct MotionFiles {
    /// The GLB file with a body, of which Blender also draws a picture.
    pub glb: PathBuf,
    /// The GLB file without a body.
    pub bare_glb: PathBuf,
    pub bvh: PathBuf,
    /// The file to which Blender exports the imported GLB file.
    pub reexported_glb: PathBuf,
    /// The expected joints as JSON: frame rate, names, and positions in metres with Y up.
    pub joints: PathBuf,
    /// The rotations that the files must hold. Their joints can differ from those of the motion, whose bones change their length.
    rotations: Rotations,
}

impl JudgedFiles {
    /// Writes the motions of [`motions`] and one that the embedded model generates.
    ///
    /// # Errors
    ///
    /// If something cannot be generated or written.
    pub fn write(folder: &Path) -> Result<JudgedFiles> {
        std::fs::create_dir_all(folder)
            .map_err(|error| format!("{}: {error}", folder.display()))?;
        let model = LaMoGen::embedded(&Device::flex())?;
        let request = Request::new("a person jumps")
            .tags([Tag::Strong, Tag::Sudden])
            .seconds(3.0)
            .steps(50)
            .seed(7);
        let jump = model.generate(&request)?;
        let mut motions = motions::named_motions();
        motions.push(("jump", jump.guided.clone()));
        Ok(JudgedFiles {
            motions: motions
                .iter()
                .map(|(name, motion)| MotionFiles::write(folder, name, motion))
                .collect::<Result<_>>()?,
            vrm: VrmFiles::write(folder, &motions)?,
            page: page(folder, &jump)?,
        })
    }
}

impl MotionFiles {
    /// Writes a motion in all formats.
    fn write(folder: &Path, name: &str, motion: &Motion) -> Result<MotionFiles> {
        let path = |ending: &str| folder.join(format!("{name}{ending}"));
        let files = MotionFiles {
            glb: path(".glb"),
            bare_glb: path("_bare.glb"),
            bvh: path(".bvh"),
            reexported_glb: path("_again.glb"),
            joints: path(".json"),
            rotations: motion.rotations().into_owned(),
        };
        let options = WriteOptions::default();
        let mut bare = options.clone();
        bare.glb.body = false;
        lamogen_files::write(&files.glb, motion, &options)?;
        lamogen_files::write(&files.bare_glb, motion, &bare)?;
        lamogen_files::write(&files.bvh, motion, &options)?;
        let expected = json!({
            "frames_per_second": files.rotations.frames_per_second(),
            "names": Joint::ALL.map(Joint::name),
            "frames": files.rotations.joints().iter().map(|pose| json!(pose)).collect::<Vec<_>>(),
        });
        write_atomically(&files.joints, |file| {
            Ok(serde_json::to_writer(file, &expected)?)
        })?;
        Ok(files)
    }

    /// Returns the largest distance in metres between a joint in Blender's export and the expected joint.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, or has another number of frames.
    pub fn reexport_error(&self) -> Result<f32> {
        let reexported = lamogen_files::read(&self.reexported_glb, &ReadOptions::default())?.motion;
        if reexported.frames() != self.rotations.frames() {
            let (expected, found) = (self.rotations.frames(), reexported.frames());
            let name = self.reexported_glb.display();
            return Err(format!("{name}: expected {expected} frames, found {found}").into());
        }
        Ok(self.rotations.distance(&reexported).largest)
    }
}

/// Writes the page that shows a motion before and after guidance.
fn page(folder: &Path, jump: &Generation) -> Result<PathBuf> {
    let path = folder.join("jump.html");
    let frames = jump.guided.frames();
    let caption = TimedCaption::new;
    let html = lamogen_view::page(&Page {
        title: "a person jumps",
        notes: "strong, sudden",
        figures: &[
            PageFigure::baseline(&jump.baseline),
            PageFigure::guided(&jump.guided),
        ],
        curves: &[
            LabanCurve::baseline(&jump.baseline_laban),
            LabanCurve::target(&jump.target),
            LabanCurve::guided(&jump.guided_laban),
        ],
        captions: &[
            caption("a person bends the knees", 0..frames / 2),
            caption("a person jumps", frames / 2..frames),
        ],
    });
    lamogen_view::save(&path, &html)?;
    Ok(path)
}
