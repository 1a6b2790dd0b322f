//! Loading of MDM at the sizes of its public checkpoints. `tests/golden/mdm/make.py --full-size FOLDER` writes the files, which
//! have random weights; `MDM_FULL_SIZE=FOLDER cargo test --release --test mdm_full_size -- --ignored --test-threads 1` reads them.

use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use lamogen_model::{Denoiser, Mdm, MdmConfig, MdmText};

fn folder(name: &str) -> PathBuf {
    let all = std::env::var_os("MDM_FULL_SIZE").expect("MDM_FULL_SIZE names the folder");
    Path::new(&all).join(name)
}

/// Loads a network. Returns it with the bytes of its files.
fn load(name: &str, weights: &str, text: (&str, fn(PathBuf, &Device) -> MdmText)) -> (Mdm, u64) {
    let (folder, device) = (folder(name), Device::flex());
    let config = MdmConfig::from_file(folder.join("args.json")).unwrap();
    let files = [folder.join(weights), folder.join(text.0)];
    let [weights, text_file] = files.clone();
    let text = (text.1)(text_file, &device);
    let weights = config.open_weights(weights).unwrap();
    let config = config.with_sizes_of(&weights).unwrap();
    let network = Mdm::load(&weights, &config, text, &device).unwrap();
    let bytes = files.map(|file| std::fs::metadata(file).unwrap().len());
    (network, bytes.iter().sum())
}

/// Returns the largest amount of memory that this process has had, in bytes (Linux).
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.unwrap().trim().trim_end_matches(" kB");
    1024 * kilobytes.parse::<u64>().unwrap()
}

fn assert_loads(name: &str, parameters: usize, (network, bytes): (Mdm, u64)) {
    let text = network.text().num_params();
    assert_eq!(network.num_params() - text, parameters, "{name}");
    let ids = Tensor::<2, Int>::from_data([[101, 1037, 2711, 102]], &Device::flex());
    let embedding = network.encode(&ids.into()).embedding;
    let sum: f32 = embedding.abs().sum().into_scalar();
    assert!(sum.is_finite() && sum > 0.0);
    let ratio = peak_memory() as f64 / bytes as f64;
    println!(
        "{name}: {ratio:.2} times the {:.0} MB of its files",
        bytes as f64 / 1e6
    );
    assert!(ratio < 1.5, "{name}: {ratio}");
}

#[test]
#[ignore = "needs files that make.py writes"]
fn an_encoder_with_clip_loads_in_little_more_memory_than_its_files() {
    let clip = |path, device: &Device| MdmText::clip(path, device).unwrap();
    let loaded = load("trans_enc", "model000750000.pt", ("clip.safetensors", clip));
    assert_loads("trans_enc", 17_880_327, loaded);
}

#[test]
#[ignore = "needs files that make.py writes"]
fn a_decoder_with_distilbert_loads_in_little_more_memory_than_its_files() {
    let bert = |path, device: &Device| MdmText::distilbert(path, device).unwrap();
    let loaded = load(
        "trans_dec",
        "model000600000.pt",
        ("distilbert.safetensors", bert),
    );
    assert_loads("trans_dec", 26_424_583, loaded);
}
