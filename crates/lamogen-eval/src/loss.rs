//! What trains an evaluator.

use burn::tensor::Tensor;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

/// Added to every difference, as by PyTorch's `pairwise_distance`.
const EPSILON: f64 = 1e-6;

/// The contrastive loss of Hadsell et al. 2006 as the public code of Guo et al. 2022 uses it: `d²` for a text and its
/// own motion, `max(0, margin - d)²` for a text and the motion `shift` places further (the last go round to the
/// first), with the Euclidean distance `d`; the sum of the two means. Shape `[1]`.
///
/// The public code has a margin of 10. Its shift is drawn anew for each batch and may be 0, which pushes true pairs
/// apart; draw it with [`random_shift`], where that does not happen.
///
/// # Shapes
///
/// - `text`, `motion`: `[batch, dim_coemb_hidden]`, row by row a true pair
///
/// # Panics
///
/// If the shapes differ, or the shift is not from 1 up to but not including the batch.
pub fn contrastive_loss(
    text: Tensor<2>,
    motion: Tensor<2>,
    shift: usize,
    margin: f64,
) -> Tensor<1> {
    let [batch, _] = text.dims();
    assert_eq!(text.dims(), motion.dims(), "one motion for each text");
    assert!(
        (1..batch).contains(&shift),
        "expected a shift from 1 to below the batch of {batch}, found {shift}"
    );
    let others = Tensor::cat(
        vec![
            motion.clone().narrow(0, shift, batch - shift),
            motion.clone().narrow(0, 0, shift),
        ],
        0,
    );
    let near = squared_distances(text.clone(), motion).mean();
    let gap = (squared_distances(text, others).sqrt().neg() + margin).clamp_min(0.0);
    near + gap.square().mean()
}

/// The mean of [`contrastive_loss`] over all shifts: every text is held against every other motion of the batch at once.
/// Shape `[1]`.
///
/// # Shapes
///
/// As there.
///
/// # Panics
///
/// If the shapes differ, or there are fewer than two pairs.
pub fn contrastive_loss_of_all(text: Tensor<2>, motion: Tensor<2>, margin: f64) -> Tensor<1> {
    let [batch, width] = text.dims();
    assert_eq!(text.dims(), motion.dims(), "one motion for each text");
    assert!(batch > 1, "expected a batch of at least 2, found {batch}");
    let near = squared_distances(text.clone(), motion.clone()).mean();
    // Differences, not products of the two: these would lose what is small beside the points' own length.
    let texts: Tensor<3> = text.unsqueeze_dim(1);
    let motions: Tensor<3> = motion.unsqueeze_dim(0);
    let texts = texts.expand([batch, batch, width]);
    let distances = (texts - motions + EPSILON).square().sum_dim(2).sqrt();
    let gaps = (distances.neg() + margin).clamp_min(0.0).square();
    let own = Tensor::<2>::eye(batch, &gaps.device()).unsqueeze_dim::<3>(2);
    let others = gaps.mask_fill(own.equal_elem(1.0), 0.0);
    near + others.sum() / (batch * (batch - 1)) as f64
}

/// `[batch, 1]`
fn squared_distances(a: Tensor<2>, b: Tensor<2>) -> Tensor<2> {
    (a - b + EPSILON).square().sum_dim(1)
}

/// A shift for [`contrastive_loss`], each as likely.
///
/// # Panics
///
/// If the batch is smaller than 2: then there is no other motion.
pub fn random_shift(batch: usize, stream: &mut ChaCha12Rng) -> usize {
    assert!(batch > 1, "expected a batch of at least 2, found {batch}");
    stream.random_range(1..batch)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use rand::SeedableRng;

    use super::*;

    fn value(text: [[f32; 2]; 3], motion: [[f32; 2]; 3], shift: usize) -> f32 {
        let device = Device::flex();
        let [text, motion] = [text, motion].map(|x| Tensor::<2>::from_data(x, &device));
        contrastive_loss(text, motion, shift, 10.0).into_scalar()
    }

    #[test]
    fn true_pairs_pay_for_distance_and_others_for_nearness() {
        let corners = [[0.0, 0.0], [3.0, 4.0], [30.0, 40.0]];
        // Others are 5, 45 and 50 apart: only the first are within the margin.
        let apart = value(corners, corners, 1);
        assert!((apart - 25.0 / 3.0).abs() < 1e-3, "{apart}");
        // Two places further the same pairs meet the other way round.
        assert!((value(corners, corners, 2) - apart).abs() < 1e-3);
        let moved = [[0.0, 2.0], [3.0, 4.0], [30.0, 40.0]];
        let first_gap = 10.0 - 5.0;
        let far = value(corners, moved, 1);
        assert!(
            (far - (4.0 + first_gap * first_gap) / 3.0).abs() < 1e-3,
            "{far}"
        );
    }

    #[test]
    fn the_gradient_pulls_a_text_to_its_motion() {
        let device = Device::flex();
        let far = Tensor::<2>::from_data([[0.0, 0.0], [90.0, 0.0]], &device);
        let text = far.clone().autodiff().require_grad();
        let motion = Tensor::<2>::from_data([[2.0, 0.0], [90.0, 0.0]], &device);
        let mut gradients = contrastive_loss(text.clone(), motion, 1, 10.0).backward();
        let gradient = text.grad_remove(&mut gradients).unwrap();
        let gradient: Vec<f32> = gradient.try_into_vec_as().unwrap();
        assert!(
            (gradient[0] + 2.0).abs() < 1e-4 && gradient[2].abs() < 1e-4,
            "{gradient:?}"
        );
    }

    #[test]
    fn all_others_are_the_mean_of_all_shifts() {
        let device = Device::flex();
        let points = |scale: f32| {
            let numbers: Vec<f32> = (0..15).map(|i| (i as f32 * scale).sin() * 5.0).collect();
            Tensor::<2>::from_data(burn::tensor::TensorData::new(numbers, [5, 3]), &device)
        };
        let losses = |all: bool| {
            let [text, motion] = [points(1.3), points(2.1)].map(|x| x.autodiff().require_grad());
            let loss = match all {
                true => contrastive_loss_of_all(text.clone(), motion.clone(), 10.0),
                false => (1..5)
                    .map(|shift| contrastive_loss(text.clone(), motion.clone(), shift, 10.0))
                    .reduce(|a, b| a + b)
                    .map_or_else(|| unreachable!("four shifts"), |sum| sum / 4.0),
            };
            let mut gradients = loss.backward();
            let gradients = [text, motion].map(|x| x.grad_remove(&mut gradients).unwrap());
            let [text, motion] = gradients.map(|x| x.reshape([15]));
            Tensor::cat(vec![loss.inner(), text, motion], 0).into_data()
        };
        let tolerance = burn::tensor::Tolerance::<f32>::rel_abs(1e-5, 1e-5);
        losses(true).assert_approx_eq::<f32>(&losses(false), tolerance);
    }

    #[test]
    fn a_shift_is_never_none() {
        let mut stream = ChaCha12Rng::seed_from_u64(5);
        let shifts: Vec<usize> = (0..200).map(|_| random_shift(4, &mut stream)).collect();
        assert!([1, 2, 3].iter().all(|shift| shifts.contains(shift)));
        assert!(shifts.iter().all(|shift| (1..4).contains(shift)));
    }
}
