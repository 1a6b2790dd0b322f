//! What is shown to the judges.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use lamogen::{Generation, LaMoGen, Request, Tag};
use lamogen_files::{ReadOptions, WriteOptions};
use lamogen_motion::{Joint, Motion, Rotations, write_atomically};
use lamogen_view::{Curve, Figure, Page};
use serde_json::json;

use super::{Result, motions};

/// Files and what is true of them.
pub struct Exhibits {
    pub takes: Vec<Take>,
    /// A page with a motion before and after guiding.
    pub page: PathBuf,
}

/// One motion in all formats of rotations.
pub struct Take {
    /// With a body: the one to draw.
    pub glb: PathBuf,
    pub bare_glb: PathBuf,
    pub bvh: PathBuf,
    /// Where Blender exports what it imported.
    pub again_glb: PathBuf,
    /// Where the joints have to be: frame rate, names, positions in metres, Y up.
    pub joints: PathBuf,
    /// What the files must hold: rotations cannot reach joints whose bones change their length.
    rotations: Rotations,
}

impl Exhibits {
    /// Writes the motions of [`motions`] and one that the embedded model generates.
    ///
    /// # Errors
    ///
    /// If something cannot be generated or written.
    pub fn write(folder: &Path) -> Result<Exhibits> {
        std::fs::create_dir_all(folder)
            .map_err(|error| format!("{}: {error}", folder.display()))?;
        let model = LaMoGen::embedded(&Device::flex())?;
        let request = Request::new("a person jumps")
            .tags([Tag::Strong, Tag::Sudden])
            .seconds(3.0)
            .steps(50)
            .seed(7);
        let jump = model.generate(&request)?;
        let mut motions = motions::all();
        motions.push(("jump", jump.guided.clone()));
        Ok(Exhibits {
            takes: motions
                .iter()
                .map(|(name, motion)| Take::write(folder, name, motion))
                .collect::<Result<_>>()?,
            page: page(folder, &jump)?,
        })
    }
}

impl Take {
    fn write(folder: &Path, name: &str, motion: &Motion) -> Result<Take> {
        let place = |ending: &str| folder.join(format!("{name}{ending}"));
        let take = Take {
            glb: place(".glb"),
            bare_glb: place("_bare.glb"),
            bvh: place(".bvh"),
            again_glb: place("_again.glb"),
            joints: place(".json"),
            rotations: motion.rotations().into_owned(),
        };
        let options = WriteOptions::default();
        let mut bare = options.clone();
        bare.glb.body = false;
        lamogen_files::write(&take.glb, motion, &options)?;
        lamogen_files::write(&take.bare_glb, motion, &bare)?;
        lamogen_files::write(&take.bvh, motion, &options)?;
        let truth = json!({
            "frames_per_second": take.rotations.frames_per_second(),
            "names": Joint::ALL.map(Joint::name),
            "frames": take.rotations.joints().iter().map(|pose| json!(pose)).collect::<Vec<_>>(),
        });
        write_atomically(&take.joints, |file| {
            Ok(serde_json::to_writer(file, &truth)?)
        })?;
        Ok(take)
    }

    /// The largest distance in metres of a joint in Blender's export from where it has to be.
    ///
    /// # Errors
    ///
    /// If the file cannot be read or has another length.
    pub fn gap_again(&self) -> Result<f32> {
        let again = lamogen_files::read(&self.again_glb, &ReadOptions::default())?.motion;
        if again.frames() != self.rotations.frames() {
            let (expected, found) = (self.rotations.frames(), again.frames());
            let name = self.again_glb.display();
            return Err(format!("{name}: expected {expected} frames, found {found}").into());
        }
        Ok(self.rotations.distance(&again).largest)
    }
}

fn page(folder: &Path, jump: &Generation) -> Result<PathBuf> {
    let path = folder.join("jump.html");
    let html = lamogen_view::page(&Page {
        title: "a person jumps",
        notes: "strong, sudden",
        figures: &[
            Figure::baseline(&jump.baseline),
            Figure::guided(&jump.guided),
        ],
        curves: &[
            Curve::baseline(&jump.baseline_laban),
            Curve::target(&jump.target),
            Curve::guided(&jump.guided_laban),
        ],
    });
    lamogen_view::save(&path, &html)?;
    Ok(path)
}
