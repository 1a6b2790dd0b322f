//! Tests of checkpoints: complete files, damaged files, and files of another model.
//!
//! tests/data has one network of 4,992 numbers in three files that `torch.save` wrote: `zip.tar`, `legacy.tar` in the older
//! format (both also contain CLIP's image tower, like the public checkpoint), and `no_encoder.pt` with the weights alone.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use burn::tensor::{Device, Int, Tensor};
use lamogen_model::{
    Checkpoint, CheckpointError, Denoiser, DenoiserInput, FrameMask, ModelConfig, MotionDiffuse,
    Precision,
};
use safetensors::tensor::{Dtype, TensorView};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name)
}

fn config() -> ModelConfig {
    ModelConfig::from_file(data("config.json")).unwrap()
}

fn load(path: &Path) -> Result<MotionDiffuse, CheckpointError> {
    Checkpoint::open(path)?.load(&config(), &Device::flex())
}

fn message(result: Result<MotionDiffuse, CheckpointError>) -> String {
    match result {
        Ok(_) => panic!("the file is damaged"),
        Err(error) => error.to_string(),
    }
}

/// Computes the output of a network for a fixed input.
fn output(model: &MotionDiffuse) -> Vec<f32> {
    let device = Device::flex();
    let prompt = model.encode(&Tensor::<2, Int>::from_data([[1, 7, 19, 0, 0]], &device).into());
    let x_t = Tensor::<1, Int>::arange(0..72, &device)
        .float()
        .sin()
        .reshape([1, 6, 12]);
    let input = DenoiserInput {
        x_t,
        timesteps: vec![321],
        time: model.embed_timesteps(&[321]),
        embedding: prompt.embedding,
        modulation: None,
        mask: FrameMask::new(&[5], 6, &device),
    };
    model
        .denoise(input, &prompt.context)
        .into_data()
        .try_to_vec()
        .unwrap()
}

#[test]
fn zip_and_legacy_pickles_hold_the_same_network() {
    let zip = output(&load(&data("zip.tar")).unwrap());
    assert_eq!(zip, output(&load(&data("legacy.tar")).unwrap()));
    assert!(zip.iter().all(|x| x.is_finite()) && zip.iter().any(|&x| x != 0.0));
}

#[test]
fn clips_image_tower_is_known_and_left_alone() {
    let checkpoint = Checkpoint::open(data("legacy.tar")).unwrap();
    assert!(
        checkpoint
            .keys()
            .iter()
            .any(|key| key == "clip.visual.proj")
    );
    checkpoint.load(&config(), &Device::flex()).unwrap();
}

#[test]
fn safetensors_keep_every_bit_or_half_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let model = load(&data("zip.tar")).unwrap();
    let before = output(&model);
    for (precision, tolerance) in [
        (Precision::F32, 0.0),
        (Precision::F16, 2e-2),
        (Precision::I8, 0.5),
    ] {
        let path = folder.path().join("model.safetensors");
        let metadata = HashMap::from([("license".to_owned(), "MIT".to_owned())]);
        model.save(&path, precision, metadata).unwrap();
        let checkpoint = Checkpoint::open(&path).unwrap();
        assert_eq!(checkpoint.metadata("license"), Some("MIT"));
        assert_eq!(checkpoint.metadata("author"), None);
        let after = output(&checkpoint.load(&config(), &Device::flex()).unwrap());
        for (before, after) in before.iter().zip(after) {
            assert!((before - after).abs() <= tolerance, "{before} {after}");
        }
    }
    // Only the finished file remains.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn saved_keys_are_those_of_the_public_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let model = load(&data("zip.tar")).unwrap();
    model.save(&path, Precision::F32, HashMap::new()).unwrap();
    let mut original = Checkpoint::open(data("zip.tar")).unwrap().keys();
    original.retain(|key| !["clip.visual.proj", "clip.logit_scale"].contains(&&**key));
    assert_eq!(Checkpoint::open(&path).unwrap().keys(), original);
}

#[test]
fn fresh_weights_save_and_load() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fresh.safetensors");
    let model = MotionDiffuse::new(&config(), &Device::flex());
    model.save(&path, Precision::F32, HashMap::new()).unwrap();
    // Loaded weights are transposed in memory, so products may be rounded differently.
    for (before, after) in output(&model).iter().zip(output(&load(&path).unwrap())) {
        assert!((before - after).abs() < 1e-5, "{before} {after}");
    }
}

#[test]
fn a_truncated_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let model = load(&data("zip.tar")).unwrap();
    let whole = folder.path().join("whole.safetensors");
    model.save(&whole, Precision::F32, HashMap::new()).unwrap();
    for (source, name) in [
        (data("zip.tar"), "cut.tar"),
        (data("legacy.tar"), "cut_legacy.tar"),
        (whole, "cut.safetensors"),
    ] {
        let bytes = std::fs::read(source).unwrap();
        for length in [0, 5, 100, bytes.len() / 2, bytes.len() - 1] {
            let path = folder.path().join(name);
            std::fs::write(&path, &bytes[..length]).unwrap();
            let message = message(load(&path));
            assert!(message.contains(name), "{length}: {message}");
            assert!(
                message.contains("not a readable checkpoint"),
                "{length}: {message}"
            );
        }
    }
}

#[test]
fn a_file_that_is_no_checkpoint_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["notes.tar", "notes.safetensors"] {
        let path = folder.path().join(name);
        std::fs::write(&path, "Dear diary, today I trained a network. ".repeat(20)).unwrap();
        let message = message(load(&path));
        assert!(message.contains(name), "{message}");
        assert!(message.contains("not a readable checkpoint"), "{message}");
    }
    let message = message(load(&folder.path().join("nothing.tar")));
    assert!(
        message.contains("nothing.tar") && message.contains("No such file"),
        "{message}"
    );
}

/// Returns a zip of empty entries.
fn zip(names: &[&str]) -> Vec<u8> {
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for name in names {
        let offset = file.len() as u32;
        let length = (name.len() as u16).to_le_bytes();
        // Version, flags, method, time, date, checksum and two sizes: all 0 but the version.
        let mut common = vec![20, 0];
        common.resize(22, 0);
        common.extend(length);
        common.extend([0; 2]);
        file.extend([b"PK\x03\x04", &common[..], name.as_bytes()].concat());
        directory.extend([b"PK\x01\x02\x14\x00", &common[..]].concat());
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let (count, start) = ((names.len() as u16).to_le_bytes(), file.len() as u32);
    let length = directory.len() as u32;
    file.extend(directory);
    file.extend([b"PK\x05\x06\0\0\0\0", &count[..], &count].concat());
    file.extend([&length.to_le_bytes()[..], &start.to_le_bytes(), &[0; 2]].concat());
    file
}

#[test]
fn a_torchscript_archive_is_told_from_a_damaged_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ViT-B-32.pt");
    let program = [
        "ViT-B-32/data.pkl",
        "ViT-B-32/code/__torch__.py",
        "ViT-B-32/constants.pkl",
    ];
    std::fs::write(&path, zip(&program)).unwrap();
    let found = message(load(&path));
    for part in [
        "TorchScript",
        "torch.jit.load('ViT-B-32.pt'",
        "state_dict()",
    ] {
        assert!(found.contains(part), "{found}");
    }
    std::fs::write(&path, zip(&program[..1])).unwrap();
    let found = message(load(&path));
    assert!(!found.contains("TorchScript"), "{found}");
}

#[test]
fn weights_without_the_key_encoder_are_refused() {
    let message = message(load(&data("no_encoder.pt")));
    assert!(message.contains("`encoder`"), "{message}");
}

#[test]
fn a_tensor_of_another_shape_is_named_with_both_shapes() {
    let mut config = config();
    config.ff_size = 16;
    let checkpoint = Checkpoint::open(data("zip.tar")).unwrap();
    let message = message(checkpoint.load(&config, &Device::flex()));
    assert!(
        message.contains("temporal_decoder_blocks.0.ffn.linear1.weight"),
        "{message}"
    );
    assert!(
        message.contains("[8, 8]") && message.contains("[16, 8]"),
        "{message}"
    );
    // The bias of the first layer and the weight of the second do not fit either.
    assert!(message.contains("2 more"), "{message}");
}

#[test]
fn a_missing_tensor_is_named() {
    let mut config = config();
    config.num_layers = 2;
    let checkpoint = Checkpoint::open(data("zip.tar")).unwrap();
    let message = message(checkpoint.load(&config, &Device::flex()));
    assert!(
        message.contains("temporal_decoder_blocks.1.") && message.contains("missing"),
        "{message}"
    );
}

#[test]
fn a_network_that_is_smaller_than_its_weights_is_no_silent_cut() {
    let mut config = config();
    config.num_text_layers = 0;
    let checkpoint = Checkpoint::open(data("zip.tar")).unwrap();
    let message = message(checkpoint.load(&config, &Device::flex()));
    assert!(message.contains("textTransEncoder.layers.0."), "{message}");
    assert!(message.contains("not part of a network"), "{message}");
}

#[test]
fn a_tensor_of_integers_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let model = load(&data("zip.tar")).unwrap();
    model.save(&path, Precision::F32, HashMap::new()).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let views: Vec<_> = tensors
        .iter()
        .map(|(key, view)| match key {
            "out.bias" => (
                key,
                TensorView::new(Dtype::I32, view.shape().to_vec(), view.data()).unwrap(),
            ),
            _ => (key, view),
        })
        .collect();
    let path = folder.path().join("integers.safetensors");
    safetensors::serialize_to_file(views, None, &path).unwrap();
    let message = message(load(&path));
    assert!(
        message.contains("`out.bias`") && message.contains("I32"),
        "{message}"
    );
}

#[test]
fn a_folder_that_is_not_there_keeps_nothing() {
    let model = MotionDiffuse::new(&config(), &Device::flex());
    let error = model
        .save(
            "no/such/folder/model.safetensors",
            Precision::F32,
            HashMap::new(),
        )
        .unwrap_err();
    assert!(error.to_string().contains("no/such/folder"), "{error}");
}

#[test]
fn damaged_files_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.safetensors");
    let model = load(&data("zip.tar")).unwrap();
    model.save(&whole, Precision::F32, HashMap::new()).unwrap();
    // A multiplicative generator (Lehmer 1951) is random enough to break files.
    let mut state = 2026u64;
    let mut random = |below: usize| {
        state = state * 48_271 % 0x7fff_ffff;
        state as usize % below
    };
    for (source, name) in [
        (data("zip.tar"), "damaged.tar"),
        (data("legacy.tar"), "damaged_legacy.tar"),
        (whole, "damaged.safetensors"),
    ] {
        let bytes = std::fs::read(source).unwrap();
        let path = folder.path().join(name);
        let mut refused = 0;
        for _ in 0..300 {
            let mut damaged = bytes.clone();
            for _ in 0..1 + random(8) {
                // Mostly in the first kilobytes, where names, shapes and lengths are.
                let place = match random(3) {
                    0 => random(bytes.len()),
                    _ => random(4096),
                };
                damaged[place] = random(256) as u8;
            }
            std::fs::write(&path, damaged).unwrap();
            refused += usize::from(load(&path).is_err());
        }
        assert!(refused > 50, "{name}: only {refused} of 300 were refused");
    }
}

#[test]
fn weights_that_are_no_numbers_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let model = load(&data("zip.tar")).unwrap();
    model.save(&path, Precision::F32, HashMap::new()).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let end = bytes.len();
    bytes[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&path, bytes).unwrap();
    let message = message(load(&path));
    assert!(
        message.contains("not finite") && message.contains("tensor `"),
        "{message}"
    );
}

#[test]
fn sizes_are_read_off_the_shapes() {
    let mut config = config();
    // The values that shapes do not determine are those of MotionDiffuse and CLIP.
    (config.latent_dim, config.num_heads, config.num_layers) = (16, 8, 11);
    (config.text_latent_dim, config.text_num_heads) = (12, 4);
    (config.clip.width, config.clip.heads) = (128, 2);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let model = MotionDiffuse::new(&config, &Device::flex());
    model.save(&path, Precision::F32, HashMap::new()).unwrap();
    assert_eq!(Checkpoint::open(&path).unwrap().config().unwrap(), config);
    // 6 channels cannot be divided among 4 heads.
    let error = Checkpoint::open(data("zip.tar")).unwrap().config();
    let message = error.unwrap_err().to_string();
    assert!(
        message.contains("zip.tar") && message.contains("heads"),
        "{message}"
    );
}

#[test]
fn sizes_that_cannot_be_read_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part.safetensors");
    let view = TensorView::new(Dtype::F32, vec![1, 2], &[0; 8]).unwrap();
    safetensors::serialize_to_file([("joint_embed.weight", view)], None, &path).unwrap();
    let error = Checkpoint::open(&path).unwrap().config().unwrap_err();
    let message = error.to_string();
    for part in ["part.safetensors", "`sequence_embedding`", "config.json"] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn converted_weights_are_the_same_network() {
    let folder = tempfile::tempdir().unwrap();
    let source = Checkpoint::open(data("legacy.tar")).unwrap();
    let before = output(&load(&data("legacy.tar")).unwrap());
    for (precision, tolerance) in [
        (Precision::F32, 0.0),
        (Precision::F16, 2e-2),
        (Precision::I8, 0.5),
    ] {
        let path = folder.path().join("converted.safetensors");
        let metadata = HashMap::from([("license".to_owned(), "MIT".to_owned())]);
        let mut seen = Vec::new();
        source
            .convert(&path, precision, metadata, &mut |converted| {
                seen.push((converted.key.to_owned(), converted.done, converted.all));
            })
            .unwrap();
        let converted = Checkpoint::open(&path).unwrap();
        assert_eq!(converted.metadata("license"), Some("MIT"));
        let keys = converted.keys();
        assert!(!keys.iter().any(|key| key.starts_with("clip.visual")));
        assert_eq!(seen.len(), keys.len());
        assert_eq!(seen.last().unwrap().1, seen.last().unwrap().2);
        let after = output(&load(&path).unwrap());
        for (before, after) in before.iter().zip(after) {
            assert!((before - after).abs() <= tolerance, "{before} {after}");
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn what_cannot_be_converted_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let (from, to) = (
        folder.path().join("large.safetensors"),
        folder.path().join("half.safetensors"),
    );
    let numbers: Vec<u8> = [1e5f32, 1.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let view = TensorView::new(Dtype::F32, vec![2], &numbers).unwrap();
    safetensors::serialize_to_file([("out.bias", view)], None, &from).unwrap();
    std::fs::write(&to, "older").unwrap();
    let checkpoint = Checkpoint::open(&from).unwrap();
    let error = checkpoint.convert(&to, Precision::F16, HashMap::new(), &mut |_| {});
    let message = error.unwrap_err().to_string();
    assert!(
        message.contains("`out.bias`") && message.contains("65504"),
        "{message}"
    );
    assert_eq!(std::fs::read_to_string(&to).unwrap(), "older");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    checkpoint
        .convert(&to, Precision::F32, HashMap::new(), &mut |_| {})
        .unwrap();
}

#[test]
fn eight_bits_are_a_quarter_and_their_scales_are_no_tensors_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, eighth] =
        ["whole", "eighth"].map(|name| folder.path().join(name).with_extension("safetensors"));
    let model = load(&data("zip.tar")).unwrap();
    model.save(&whole, Precision::F32, HashMap::new()).unwrap();
    model.save(&eighth, Precision::I8, HashMap::new()).unwrap();
    let [whole_keys, keys] = [&whole, &eighth].map(|path| Checkpoint::open(path).unwrap().keys());
    assert_eq!(whole_keys, keys);
    // Converting back to 32 bits loses nothing more.
    let back = folder.path().join("back.safetensors");
    let checkpoint = Checkpoint::open(&eighth).unwrap();
    checkpoint
        .convert(&back, Precision::F32, HashMap::new(), &mut |_| {})
        .unwrap();
    assert_eq!(
        output(&load(&eighth).unwrap()),
        output(&load(&back).unwrap())
    );
    // Integers without scales are not valid weights.
    let numbers = [1u8, 2];
    let view = TensorView::new(Dtype::I8, vec![2, 1], &numbers).unwrap();
    safetensors::serialize_to_file([("out.weight", view)], None, &back).unwrap();
    let error = Checkpoint::open(&back).unwrap().convert(
        &whole,
        Precision::F32,
        HashMap::new(),
        &mut |_| {},
    );
    let message = error.unwrap_err().to_string();
    assert!(
        message.contains("`out.weight`") && message.contains("out.weight.scale"),
        "{message}"
    );
}
