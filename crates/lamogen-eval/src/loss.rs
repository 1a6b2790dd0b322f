//! The contrastive losses that train an evaluator.

use burn::tensor::Tensor;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

/// The number that is added to every difference, as in PyTorch's `pairwise_distance`.
const EPSILON: f64 = 1e-6;

/// Computes the contrastive loss of Hadsell et al. 2006 in the form of the public code of Guo et al. 2022. Shape `[1]`.
///
/// The loss is the sum of two means over the texts, with the Euclidean distance `d`: `d²` for a text and its own motion,
/// and `max(0, margin - d)²` for a text and another motion, the one `shift` rows further (counted cyclically).
///
/// The public code has a margin of 10. It draws a new shift for each batch, which may be 0 and then pushes true pairs
/// apart; [`random_shift`] draws a shift that is never 0.
///
/// # Shapes
///
/// - `text`, `motion`: `[batch, dim_coemb_hidden]`; each row of `text` and the same row of `motion` are a true pair
///
/// # Panics
///
/// If the shapes differ, or the shift is not at least 1 and less than the batch size.
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

/// Computes the mean of [`contrastive_loss`] over all shifts: every text is compared with every other motion of the
/// batch. Shape `[1]`.
///
/// # Shapes
///
/// - `text`, `motion`: as for [`contrastive_loss`]
///
/// # Panics
///
/// If the shapes differ, or there are fewer than two pairs.
pub fn contrastive_loss_all_shifts(text: Tensor<2>, motion: Tensor<2>, margin: f64) -> Tensor<1> {
    let [batch, width] = text.dims();
    assert_eq!(text.dims(), motion.dims(), "one motion for each text");
    assert!(batch > 1, "expected a batch of at least 2, found {batch}");
    let near = squared_distances(text.clone(), motion.clone()).mean();
    // Distances are computed from differences. Computed from dot products, a distance that is small beside the length
    // of the embeddings would be lost in rounding.
    let texts: Tensor<3> = text.unsqueeze_dim(1);
    let motions: Tensor<3> = motion.unsqueeze_dim(0);
    let texts = texts.expand([batch, batch, width]);
    let distances = (texts - motions + EPSILON).square().sum_dim(2).sqrt();
    let gaps = (distances.neg() + margin).clamp_min(0.0).square();
    let own = Tensor::<2>::eye(batch, &gaps.device()).unsqueeze_dim::<3>(2);
    let others = gaps.mask_fill(own.equal_elem(1.0), 0.0);
    near + others.sum() / (batch * (batch - 1)) as f64
}

/// Returns the squared distance of each pair of rows, `[batch, 1]`.
fn squared_distances(a: Tensor<2>, b: Tensor<2>) -> Tensor<2> {
    (a - b + EPSILON).square().sum_dim(1)
}

/// Draws a shift for [`contrastive_loss`]; all shifts from 1 to `batch - 1` are equally likely.
///
/// # Panics
///
/// If the batch is smaller than 2, because then there is no other motion.
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
    fn the_loss_grows_with_the_distance_of_true_pairs_and_the_nearness_of_others() {
        let corners = [[0.0, 0.0], [3.0, 4.0], [30.0, 40.0]];
        // The distances of other pairs are 5, 45 and 50: only the first is below the margin.
        let loss = value(corners, corners, 1);
        assert!((loss - 25.0 / 3.0).abs() < 1e-3, "{loss}");
        // A shift of 2 compares the same pairs, with text and motion exchanged.
        assert!((value(corners, corners, 2) - loss).abs() < 1e-3);
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
    fn the_loss_of_all_is_the_mean_of_all_shifts() {
        let device = Device::flex();
        let points = |scale: f32| {
            let numbers: Vec<f32> = (0..15).map(|i| (i as f32 * scale).sin() * 5.0).collect();
            Tensor::<2>::from_data(burn::tensor::TensorData::new(numbers, [5, 3]), &device)
        };
        let losses = |all: bool| {
            let [text, motion] = [points(1.3), points(2.1)].map(|x| x.autodiff().require_grad());
            let loss = match all {
                true => contrastive_loss_all_shifts(text.clone(), motion.clone(), 10.0),
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
    fn a_random_shift_is_never_0() {
        let mut stream = ChaCha12Rng::seed_from_u64(5);
        let shifts: Vec<usize> = (0..200).map(|_| random_shift(4, &mut stream)).collect();
        assert!([1, 2, 3].iter().all(|shift| shifts.contains(shift)));
        assert!(shifts.iter().all(|shift| (1..4).contains(shift)));
    }
}
