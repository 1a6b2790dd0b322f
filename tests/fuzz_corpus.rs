//! Replays the corpus of the fuzz targets.

use std::path::Path;
use std::time::{Duration, Instant};

#[path = "../fuzz/src/targets.rs"]
mod targets;

#[test]
fn every_input_of_the_corpus_is_read_or_refused() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus");
    for (name, target) in targets::TARGETS {
        let folder = corpus.join(name);
        let files = std::fs::read_dir(&folder).unwrap_or_else(|_| panic!("{}", folder.display()));
        let mut count = 0;
        for file in files {
            let path = file.unwrap().path();
            let bytes = std::fs::read(&path).unwrap();
            let start = Instant::now();
            target(&bytes);
            // A wide limit: an input that hangs takes minutes, and machines that test are busy.
            let taken = start.elapsed();
            assert!(
                taken < Duration::from_secs(20),
                "{}: {taken:?}",
                path.display()
            );
            count += 1;
        }
        assert!(count > 0, "{name} has no corpus");
    }
}
