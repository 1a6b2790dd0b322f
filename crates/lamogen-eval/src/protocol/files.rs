//! Where the files of the public evaluator lie.

use std::fmt;
use std::path::{Path, PathBuf};

/// The files of the public evaluator in a folder, as users of the field have them.
///
/// ```text
/// FOLDER/text_mot_match/model/finest.tar     the networks
///        Comp_v6_KLD01/meta/mean.npy, std.npy    the statistics that they were trained with
///        glove/our_vab_data.npy, our_vab_words.pkl, our_vab_idx.pkl    the words
/// ```
///
/// The folder may also be the one above, with the first two in `t2m` or `checkpoints/t2m`, or the folder `t2m` itself, with `glove` up to three
/// folders above. Statistics are also found in `Comp_v6_KLD005/meta` or `text_mot_match/meta`, or as `t2m_mean.npy` and `t2m_std.npy`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublicFiles {
    folder: PathBuf,
    network: Option<PathBuf>,
    mean: Option<PathBuf>,
    std: Option<PathBuf>,
    glove: Option<PathBuf>,
    missing: Vec<PublicFile>,
}

/// A file of the public evaluator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PublicFile {
    /// The networks.
    Network,
    /// The mean of the features.
    Mean,
    /// The standard deviation of the features.
    Std,
    /// The vectors of the words.
    WordVectors,
    /// The list of the words.
    Words,
    /// The row of each word.
    WordRows,
}

/// The folders of a release, relative to the given one.
const RELEASES: [&str; 3] = ["", "t2m", "checkpoints/t2m"];
const NETWORKS: [&str; 2] = ["text_mot_match/model/finest.tar", "finest.tar"];
const STATISTICS: [&str; 5] = [
    "Comp_v6_KLD01/meta",
    "Comp_v6_KLD005/meta",
    "text_mot_match/meta",
    "meta",
    "",
];
/// Endings of the statistics' names in front of `mean.npy` and `std.npy`.
const PREFIXES: [&str; 2] = ["", "t2m_"];
const GLOVES: [&str; 5] = [
    "glove",
    "../glove",
    "../../glove",
    "../../../glove",
    "data/glove",
];

impl PublicFile {
    /// All files.
    pub const ALL: [PublicFile; 6] = [
        PublicFile::Network,
        PublicFile::Mean,
        PublicFile::Std,
        PublicFile::WordVectors,
        PublicFile::Words,
        PublicFile::WordRows,
    ];

    /// Returns the file's usual place in the folder.
    pub const fn place(self) -> &'static str {
        match self {
            PublicFile::Network => "text_mot_match/model/finest.tar",
            PublicFile::Mean => "Comp_v6_KLD01/meta/mean.npy",
            PublicFile::Std => "Comp_v6_KLD01/meta/std.npy",
            PublicFile::WordVectors => "glove/our_vab_data.npy",
            PublicFile::Words => "glove/our_vab_words.pkl",
            PublicFile::WordRows => "glove/our_vab_idx.pkl",
        }
    }

    /// Returns where people get the file.
    pub const fn source(self) -> &'static str {
        match self {
            PublicFile::Network | PublicFile::Mean | PublicFile::Std => {
                "the models for HumanML3D that the README of github.com/EricGuo5513/text-to-motion links to (the folder checkpoints/t2m)"
            }
            PublicFile::WordVectors | PublicFile::Words | PublicFile::WordRows => {
                "the folder glove of github.com/EricGuo5513/text-to-motion"
            }
        }
    }

    /// Returns what cannot be computed without the file.
    pub const fn needed_for(self) -> &'static str {
        match self {
            PublicFile::Network | PublicFile::Mean | PublicFile::Std => {
                "R-precision, MM-Dist, FID, Diversity and MultiModality"
            }
            PublicFile::WordVectors | PublicFile::Words | PublicFile::WordRows => {
                "R-precision and MM-Dist"
            }
        }
    }
}

impl fmt::Display for PublicFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.place())
    }
}

impl PublicFiles {
    /// Looks for the files in a folder. It may have all, some or none of them.
    pub fn find(folder: impl AsRef<Path>) -> PublicFiles {
        let folder = folder.as_ref();
        let releases = || RELEASES.iter().map(|release| folder.join(release));
        let network = releases()
            .flat_map(|release| NETWORKS.map(|name| release.join(name)))
            .find(|path| path.exists());
        // Mean and deviation belong together: a folder with both goes before one with only one of them.
        let pairs: Vec<[PathBuf; 2]> = releases()
            .flat_map(|release| STATISTICS.map(|place| release.join(place)))
            .flat_map(|place| {
                PREFIXES.map(|prefix| {
                    ["mean", "std"].map(|name| place.join(format!("{prefix}{name}.npy")))
                })
            })
            .collect();
        let count = |pair: &&[PathBuf; 2]| pair.iter().filter(|path| path.exists()).count();
        let best = (pairs.iter().find(|pair| count(pair) == 2))
            .or_else(|| pairs.iter().find(|pair| count(pair) == 1));
        let [mean, std] = [0, 1].map(|place| {
            let path = best.map(|pair| pair[place].clone());
            path.filter(|path| path.exists())
        });
        let words = [
            PublicFile::WordVectors,
            PublicFile::Words,
            PublicFile::WordRows,
        ];
        let has = |glove: &Path, file: PublicFile| {
            let name = file.place().rsplit('/').next().expect("a name");
            glove.join(name).exists()
        };
        let gloves = GLOVES.map(|place| folder.join(place));
        let some_words = gloves
            .into_iter()
            .find(|glove| words.iter().any(|&file| has(glove, file)));
        let mut missing = Vec::new();
        let single = [
            (PublicFile::Network, &network),
            (PublicFile::Mean, &mean),
            (PublicFile::Std, &std),
        ];
        missing.extend(
            { single.into_iter() }.filter_map(|(file, path)| path.is_none().then_some(file)),
        );
        missing.extend(words.into_iter().filter(|&file| match &some_words {
            Some(glove) => !has(glove, file),
            None => true,
        }));
        let has_all_words = words.iter().all(|file| !missing.contains(file));
        PublicFiles {
            folder: folder.to_owned(),
            network,
            mean,
            std,
            glove: some_words.filter(|_| has_all_words),
            missing,
        }
    }

    /// Returns whether the folder has any of the files. Statistics that lie in the folder itself do not count, because evaluators that lamogen trains have them there, too.
    pub fn is_any(&self) -> bool {
        let is_own = |path: &Option<PathBuf>| {
            let folder = path.as_ref().and_then(|path| path.parent());
            folder.is_some_and(|folder| folder.ends_with("meta"))
        };
        let words = [
            PublicFile::WordVectors,
            PublicFile::Words,
            PublicFile::WordRows,
        ];
        let has_words = words.iter().any(|file| !self.missing.contains(file));
        self.network.is_some() || has_words || is_own(&self.mean) || is_own(&self.std)
    }

    /// Returns the folder that was looked in.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the path of the networks.
    pub fn network(&self) -> Option<&Path> {
        self.network.as_deref()
    }

    /// Returns the paths of mean and standard deviation, if both are there.
    pub fn statistics(&self) -> Option<[&Path; 2]> {
        Some([self.mean.as_deref()?, self.std.as_deref()?])
    }

    /// Returns the folder of the words, if all three files of them are there.
    pub fn glove(&self) -> Option<&Path> {
        self.glove.as_deref()
    }

    /// Returns the files that are missing.
    pub fn missing(&self) -> &[PublicFile] {
        &self.missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(folder: &Path, places: &[&str]) {
        for place in places {
            let path = folder.join(place);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
    }

    #[test]
    fn files_are_found_in_the_layouts_that_people_have() {
        let all = PublicFile::ALL.map(PublicFile::place);
        let in_release = |release: &str| {
            all.map(|place| match place.starts_with("glove") {
                true => place.to_owned(),
                false => format!("{release}{place}"),
            })
        };
        for release in ["", "t2m/", "checkpoints/t2m/"] {
            let folder = tempfile::tempdir().unwrap();
            let places = in_release(release);
            put(folder.path(), &places.each_ref().map(String::as_str));
            let found = PublicFiles::find(folder.path());
            assert_eq!(found.missing(), [], "{release}");
            assert!(found.network().unwrap().ends_with(all[0]));
            assert!(found.glove().unwrap().ends_with("glove"));
            // The release's own folder has the words above it.
            let found = PublicFiles::find(folder.path().join(release));
            assert_eq!(found.missing(), [], "{release}");
        }
    }

    #[test]
    fn every_missing_file_is_named() {
        for file in PublicFile::ALL {
            let folder = tempfile::tempdir().unwrap();
            let others = PublicFile::ALL.into_iter().filter(|other| *other != file);
            let others: Vec<&str> = others.map(PublicFile::place).collect();
            put(folder.path(), &others);
            let found = PublicFiles::find(folder.path());
            assert_eq!(found.missing(), [file]);
            assert!(found.is_any());
        }
        let folder = tempfile::tempdir().unwrap();
        let found = PublicFiles::find(folder.path());
        assert_eq!(found.missing(), PublicFile::ALL);
        assert!(!found.is_any());
    }

    #[test]
    fn mean_and_deviation_are_taken_from_one_folder() {
        let folder = tempfile::tempdir().unwrap();
        let places = ["Comp_v6_KLD01/meta/mean.npy", "t2m_mean.npy", "t2m_std.npy"];
        put(folder.path(), &places);
        let found = PublicFiles::find(folder.path());
        let [mean, std] = found.statistics().unwrap();
        assert!(mean.ends_with("t2m_mean.npy") && std.ends_with("t2m_std.npy"));
    }
}
