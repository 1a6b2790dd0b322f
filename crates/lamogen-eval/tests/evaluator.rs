//! Tests of evaluators: their folders, their embeddings, and R-precision of captioned motions.

use std::collections::HashMap;

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Tensor, TensorData};
use lamogen_eval::{
    CaptionedMotions, Embeddings, Evaluator, EvaluatorConfig, EvaluatorError, EvaluatorNetwork,
    MetricError, TextBatch, TextForm, evaluate_real_motions,
};
use lamogen_model::{Precision, train_tokenizer};

const FEATURES: usize = 12;

fn config() -> EvaluatorConfig {
    EvaluatorConfig {
        dim_pose: FEATURES,
        max_motion_length: 40,
        dim_movement_enc_hidden: 16,
        dim_movement_latent: 16,
        dim_motion_hidden: 16,
        dim_text_hidden: 16,
        dim_coemb_hidden: 8,
        text: TextForm::Tokens {
            vocab_size: 280,
            context_length: 24,
            dim_word: 12,
        },
    }
}

fn tokenizer() -> Vec<u8> {
    let texts = ["a man walks", "a man walks on and on", "she jumps"];
    train_tokenizer(texts.into_iter(), 280).unwrap()
}

fn evaluator() -> Evaluator {
    let device = Device::flex();
    let evaluator = EvaluatorNetwork::initial(&config(), 3, &device);
    let mean: Vec<f32> = (0..FEATURES).map(|i| i as f32 * 0.1).collect();
    let std: Vec<f32> = (0..FEATURES).map(|i| 0.5 + i as f32 * 0.1).collect();
    Evaluator::new(evaluator, Some(&tokenizer()), [&mean, &std], &device).unwrap()
}

fn motion(frames: usize) -> Vec<f32> {
    let count = frames * FEATURES;
    (0..count)
        .map(|i| ((i * frames) as f32 * 0.37).sin())
        .collect()
}

/// Returns the largest difference of numbers at the same index.
fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    { a.iter().zip(b) }
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max)
}

#[test]
fn embeddings_are_the_networks_in_the_order_of_the_inputs() {
    let evaluator = evaluator();
    let texts = ["a man walks on and on and on", "jumps", "a man walks"];
    let text_embeddings = evaluator.texts(&texts).unwrap();
    // There are more motions than in one batch, and they are not sorted by length. Up to three frames at the end of some
    // are ignored.
    let lengths: Vec<usize> = (0..70).map(|i| 4 + i * 7 % 40).collect();
    let motions: Vec<Vec<f32>> = lengths.iter().map(|&frames| motion(frames)).collect();
    let motion_embeddings = evaluator.motions(&motions).unwrap();
    assert_eq!((text_embeddings.len(), motion_embeddings.len()), (3, 70));
    assert_eq!(motion_embeddings.width(), 8);

    let device = Device::flex();
    let row = |tensor: Tensor<2>| tensor.into_data().iter::<f32>().collect::<Vec<_>>();
    for (index, text) in texts.iter().enumerate() {
        let tokens = evaluator.tokenizer().encode(text).unwrap();
        let alone = TextBatch::tokens(&[tokens], &device);
        let alone = row(evaluator.network().embed_text(&alone));
        assert!(largest_difference(text_embeddings.row(index), &alone) < 1e-4);
    }
    for (index, (&frames, motion)) in lengths.iter().zip(&motions).enumerate() {
        let normalised: Vec<f32> = { motion.chunks(FEATURES) }
            .flat_map(|frame| {
                let read = frame[..FEATURES - EvaluatorConfig::CONTACTS]
                    .iter()
                    .enumerate();
                read.map(|(i, x)| (x - i as f32 * 0.1) / (0.5 + i as f32 * 0.1))
            })
            .collect();
        let shape = [1, frames, FEATURES - EvaluatorConfig::CONTACTS];
        let frames = frames.min(40);
        let features = Tensor::<3>::from_data(TensorData::new(normalised, shape), &device);
        let features = features.narrow(1, 0, frames);
        let alone = row(evaluator.network().embed_motion(features, &[frames], None));
        assert!(
            largest_difference(motion_embeddings.row(index), &alone) < 1e-4,
            "{frames} frames"
        );
    }
    assert!(evaluator.texts(&[""; 0]).unwrap().is_empty());
}

#[test]
fn an_evaluator_loads_from_the_folder_that_it_was_saved_to() {
    let evaluator = evaluator();
    let folder = tempfile::tempdir().unwrap();
    let save = |precision| {
        evaluator
            .save(folder.path(), precision, HashMap::new())
            .unwrap()
    };
    save(Precision::F32);
    let loaded = Evaluator::load(folder.path(), &Device::flex()).unwrap();
    // Weights from a file have another memory layout, so that products are summed in another order.
    let same = |found: Embeddings, expected: Embeddings| {
        assert_eq!(found.len(), 2);
        assert!((0..2).all(|row| largest_difference(found.row(row), expected.row(row)) < 1e-5));
    };
    let texts = ["she jumps", "a man walks"];
    same(
        loaded.texts(&texts).unwrap(),
        evaluator.texts(&texts).unwrap(),
    );
    let motions = [motion(20), motion(31)];
    same(
        loaded.motions(&motions).unwrap(),
        evaluator.motions(&motions).unwrap(),
    );

    let error = || {
        Evaluator::load(folder.path(), &Device::flex())
            .unwrap_err()
            .to_string()
    };
    let npy = |name: &str, numbers: &[f32]| {
        lamogen_motion::npy::write(folder.path().join(name), numbers, &[numbers.len()]).unwrap();
    };
    npy("std.npy", &[0.0; FEATURES]);
    assert!(error().contains("std.npy"), "{}", error());
    npy("std.npy", &[1.0; FEATURES + 1]);
    assert!(
        error().contains("std.npy") && error().contains("12"),
        "{}",
        error()
    );
    save(Precision::F32);
    std::fs::remove_file(folder.path().join("tokenizer.json")).unwrap();
    assert!(
        error().contains("280") && error().contains("49408"),
        "{}",
        error()
    );
    std::fs::write(folder.path().join("tokenizer.json"), "{}").unwrap();
    assert!(error().contains("tokenizer.json"), "{}", error());
}

#[test]
fn inputs_that_an_evaluator_cannot_read_are_named() {
    let (evaluator, device) = (evaluator(), Device::flex());
    let refused = |numbers: usize| {
        let motions = [motion(8), vec![0.0; numbers]];
        evaluator.motions(&motions).unwrap_err().to_string()
    };
    for numbers in [0, 3 * FEATURES, 8 * FEATURES + 1, 44 * FEATURES] {
        let message = refused(numbers);
        let expected = format!("motion 1: expected 4 to 40 frames of 12 numbers, found {numbers}");
        assert!(message.starts_with(&expected), "{message}");
    }
    let mut broken = motion(8);
    broken[FEATURES] = f32::NAN;
    let error = evaluator.motions(&[broken]).unwrap_err();
    assert!(
        matches!(
            error,
            EvaluatorError::Metric(MetricError::NotFinite { row: 0 })
        ),
        "{error}"
    );

    let statistics: [&[f32]; 2] = [&[0.0; 5], &[1.0; 5]];
    let evaluator = EvaluatorNetwork::new(&config(), &device);
    let error = Evaluator::new(evaluator, Some(&tokenizer()), statistics, &device).unwrap_err();
    let five = matches!(
        error,
        EvaluatorError::Features {
            expected: 12,
            found: 5
        }
    );
    assert!(five, "{error}");
    let words = EvaluatorConfig {
        text: TextForm::Words {
            dim_word: 3,
            dim_pos_ohot: 2,
        },
        ..config()
    };
    let evaluator = EvaluatorNetwork::new(&words, &device);
    let error = Evaluator::new(evaluator, Some(&tokenizer()), statistics, &device).unwrap_err();
    assert!(matches!(error, EvaluatorError::Words), "{error}");
}

#[test]
fn a_network_that_has_learned_nothing_is_at_chance() {
    let motions = |count: usize| {
        (0..count).map(|i| {
            let captions = vec![format!("man number {i}"), format!("walk {i}")];
            (captions, motion(4 + i % 37))
        })
    };
    let captioned = CaptionedMotions::embed(&evaluator(), motions(600)).unwrap();
    assert_eq!(captioned.len(), 600);
    let real = evaluate_real_motions(&captioned, 20, 5).unwrap();
    // 600 motions make 18 batches of 32.
    assert_eq!(
        (real.motions, real.batches, real.repetitions),
        (600, 20 * 18, 20)
    );
    for (rank, found) in real.r_precision.iter().enumerate() {
        let chance = (rank + 1) as f64 / 32.0;
        assert!((found.mean - chance).abs() < 0.02, "{found:?}");
        assert!(found.interval > 0.0 && found.interval < 0.01, "{found:?}");
    }
    assert!(real.distance.mean > 0.0);
    assert_eq!(real, evaluate_real_motions(&captioned, 20, 5).unwrap());
    assert_ne!(real, evaluate_real_motions(&captioned, 20, 6).unwrap());

    let few = CaptionedMotions::embed(&evaluator(), motions(31)).unwrap();
    let error = evaluate_real_motions(&few, 1, 0).unwrap_err().to_string();
    assert!(
        error.contains("at least 32") && error.contains("found 31"),
        "{error}"
    );
}

/// The count of numbers, the mean and the standard deviation of every parameter.
#[derive(Default)]
struct Moments(Vec<(usize, f64, f64)>);

impl ModuleVisitor for Moments {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let numbers: Vec<f64> = param.val().into_data().iter::<f64>().collect();
        let count = numbers.len() as f64;
        let mean = numbers.iter().sum::<f64>() / count;
        let squares = numbers.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
        self.0.push((numbers.len(), mean, (squares / count).sqrt()));
    }
}

#[test]
fn initial_weights_have_the_public_codes_distributions_and_depend_on_the_seed() {
    let device = Device::flex();
    let wide = EvaluatorConfig {
        dim_motion_hidden: 48,
        dim_text_hidden: 56,
        ..config()
    };
    let moments = |evaluator: &EvaluatorNetwork| {
        let mut moments = Moments::default();
        evaluator.visit(&mut moments);
        moments.0
    };
    let [drawn, new] = [
        EvaluatorNetwork::initial(&wide, 1, &device),
        EvaluatorNetwork::new(&wide, &device),
    ]
    .map(|evaluator| moments(&evaluator));
    assert_eq!(drawn.len(), new.len());
    for (place, (&(count, mean, deviation), &(_, expected_mean, expected))) in
        drawn.iter().zip(&new).enumerate()
    {
        // Both are random samples, so means and deviations of few numbers, as of a bias, differ more.
        let tolerance = 6.0 * expected / (count as f64).sqrt() + 1e-9;
        assert!(
            (mean - expected_mean).abs() < tolerance,
            "{place}: {mean}, {expected_mean}"
        );
        assert!(
            (deviation - expected).abs() < tolerance,
            "{place}: {deviation}, {expected}"
        );
    }
    assert_eq!(
        drawn,
        moments(&EvaluatorNetwork::initial(&wide, 1, &device))
    );
    assert_ne!(
        drawn,
        moments(&EvaluatorNetwork::initial(&wide, 2, &device))
    );
}
