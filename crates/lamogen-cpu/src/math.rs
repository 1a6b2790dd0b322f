//! Functions of one number and sums over a row, written so that the compiler vectorises them.
//!
//! The small functions are inlined into the loops that are marked `multiversion`, here and in other modules. These loops
//! are compiled for the widest vectors of several generations of processors, and the version for the machine's processor
//! is chosen at run time.

use multiversion::multiversion;

/// Computes `eˣ` with a relative error of 1e-7, clamped to the range from 1e-38 to 2e38. NaN stays NaN.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    /// Adding this constant to a number leaves the rounded integer in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87.3, 88.37);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let integer = shifted - ROUND;
    let rest = x - integer * LN_2_HIGH - integer * LN_2_LOW;
    // Cephes' polynomial for |rest| ≤ ln 2 / 2.
    let mut series = 1.987_569_1e-4;
    for coefficient in [
        1.398_199_9e-3,
        8.333_452e-3,
        4.166_579_6e-2,
        0.166_666_65,
        0.5,
    ] {
        series = series * rest + coefficient;
    }
    let fraction = series * (rest * rest) + rest + 1.0;
    let power = f32::from_bits(shifted.to_bits().wrapping_add(127) << 23);
    fraction * power
}

/// Computes `1 / (1 + e⁻ˣ)`.
#[inline(always)]
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// Computes `x · sigmoid(x)`.
#[inline(always)]
pub(crate) fn silu(x: f32) -> f32 {
    x * sigmoid(x)
}

/// Computes the derivative of [`silu`].
#[inline(always)]
pub(crate) fn silu_derivative(x: f32) -> f32 {
    let sigmoid = sigmoid(x);
    sigmoid * (1.0 + x * (1.0 - sigmoid))
}

/// Computes the standard normal distribution function with an error of 2e-7.
#[inline(always)]
pub(crate) fn normal_cdf(x: f32) -> f32 {
    0.5 + 0.5 * erf(x * std::f32::consts::FRAC_1_SQRT_2)
}

/// Computes the standard normal density.
#[inline(always)]
pub(crate) fn normal_pdf(x: f32) -> f32 {
    const AT_ZERO: f32 = 0.398_942_3;
    AT_ZERO * exp(-0.5 * x * x)
}

/// Computes the error function as a quotient of two polynomials (minimax on ±4; outside this range the error function is
/// ±1 in 32 bits).
#[inline(always)]
fn erf(x: f32) -> f32 {
    let x = x.clamp(-4.0, 4.0);
    let square = x * x;
    let mut numerator = -2.726_142_3e-10;
    for coefficient in [
        2.770_681_4e-8,
        -2.101_024e-6,
        -5.692_506_5e-5,
        -7.349_906_4e-4,
        -2.954_6e-3,
        -1.609_603_3e-2,
    ] {
        numerator = numerator * square + coefficient;
    }
    let mut denominator = -1.456_607_2e-5;
    for coefficient in [
        -2.133_740_6e-4,
        -1.682_827e-3,
        -7.373_329e-3,
        -1.426_473_9e-2,
    ] {
        denominator = denominator * square + coefficient;
    }
    x * numerator / denominator
}

/// The number of partial sums that are formed side by side before they are added up: as many as the widest vector
/// register holds.
const LANES: usize = 16;

/// Sums `term(a[i], b[i])` over two rows, in an order that depends only on the length of the rows.
#[inline(always)]
pub(crate) fn sum(a: &[f32], b: &[f32], term: impl Fn(f32, f32) -> f32) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut lanes = [0.0f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            lanes[lane] += term(a[lane], b[lane]);
        }
    }
    let mut total = reduce_lanes(lanes, |a, b| a + b);
    for (a, b) in a_rest.iter().zip(b_rest) {
        total += term(*a, *b);
    }
    total
}

/// Combines all lanes into one number: one half of the lanes is combined with the other half until one lane is left.
#[inline(always)]
fn reduce_lanes(mut lanes: [f32; LANES], combine: impl Fn(f32, f32) -> f32) -> f32 {
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            lanes[lane] = combine(lanes[lane], lanes[lane + half]);
        }
        half /= 2;
    }
    lanes[0]
}

/// Computes the dot product of two rows.
#[inline(always)]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let [product] = dots(a, &[b]);
    product
}

/// Computes the dot products of a row with several others at once. Each equals the result of [`dot`].
#[inline(always)]
pub(crate) fn dots<const N: usize>(a: &[f32], others: &[&[f32]; N]) -> [f32; N] {
    let (whole, rest) = a.as_chunks::<LANES>();
    let others = others.map(|b| b[..a.len()].as_chunks::<LANES>());
    let mut registers = [[0.0f32; LANES]; N];
    for (place, a) in whole.iter().enumerate() {
        for (lanes, (b, _)) in registers.iter_mut().zip(&others) {
            let b = &b[place];
            for lane in 0..LANES {
                lanes[lane] += a[lane] * b[lane];
            }
        }
    }
    let mut totals = registers.map(|lanes| reduce_lanes(lanes, |a, b| a + b));
    for (total, (_, b)) in totals.iter_mut().zip(&others) {
        for (a, b) in rest.iter().zip(*b) {
            *total += a * b;
        }
    }
    totals
}

/// Sums the numbers of a row.
#[inline(always)]
pub(crate) fn total(row: &[f32]) -> f32 {
    sum(row, row, |x, _| x)
}

/// Returns the larger of two numbers. `f32::max` would hide NaN from the sums that follow.
#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// Returns the largest number of a row.
#[inline(always)]
pub(crate) fn largest(row: &[f32]) -> f32 {
    let mut lanes = [f32::NEG_INFINITY; LANES];
    let mut chunks = row.chunks_exact(LANES);
    for chunk in &mut chunks {
        for (largest, x) in lanes.iter_mut().zip(chunk) {
            *largest = larger(*largest, *x);
        }
    }
    let rest = chunks.remainder().iter().copied();
    rest.fold(reduce_lanes(lanes, larger), larger)
}

/// Adds a row to `sums`.
#[inline(always)]
pub(crate) fn add_row(sums: &mut [f32], row: &[f32]) {
    for (sum, x) in sums.iter_mut().zip(row) {
        *sum += x;
    }
}

/// Multiplies each number of every row by the factor of its channel.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn scale(rows: &mut [f32], factors: &[f32]) {
    for row in rows.chunks_exact_mut(factors.len()) {
        for (x, factor) in row.iter_mut().zip(factors) {
            *x *= factor;
        }
    }
}

/// Adds `numbers` to `sums`, element by element.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn add(sums: &mut [f32], numbers: &[f32]) {
    add_row(sums, numbers);
}

/// Adds every row to `sums`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn add_rows(sums: &mut [f32], rows: &[f32]) {
    for row in rows.chunks_exact(sums.len()) {
        add_row(sums, row);
    }
}

/// Adds the elementwise products of the rows of two matrices to `sums`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
pub(crate) fn add_products(sums: &mut [f32], a: &[f32], b: &[f32]) {
    let width = sums.len();
    for (a, b) in a.chunks_exact(width).zip(b.chunks_exact(width)) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_right_over_their_whole_range() {
        for i in -87_000..88_370 {
            let x = i as f32 * 1e-3;
            let exact = f64::from(x).exp();
            let error = (f64::from(exp(x)) - exact).abs() / exact;
            assert!(error < 1.5e-7, "exp({x}): {error}");
        }
        assert_eq!(exp(0.0), 1.0);
        assert!(exp(-1e9) < 2e-38);
        assert!(exp(f32::INFINITY) > 2e38);
        assert!(exp(f32::NAN).is_nan());
    }

    #[test]
    fn normal_distribution_is_right_everywhere() {
        for i in -8_000..8_000 {
            let x = i as f32 * 1e-3;
            let exact = 0.5 * libm::erfc(-f64::from(x) / std::f64::consts::SQRT_2);
            let error = (f64::from(normal_cdf(x)) - exact).abs();
            assert!(error < 2e-7, "Φ({x}): {error}");
        }
        assert!(normal_cdf(f32::NAN).is_nan());
        assert!((normal_pdf(1.0) - 0.241_970_72).abs() < 1e-7);
    }

    #[test]
    fn sums_count_every_number() {
        for count in [0, 1, 15, 16, 17, 63, 64, 65, 100, 144] {
            let row: Vec<f32> = (0..count).map(|i| i as f32).collect();
            let expected = (count * count - count) as f32 / 2.0;
            assert_eq!(total(&row), expected);
            let twice = vec![2.0; count];
            assert_eq!(dot(&row, &twice), 2.0 * expected);
            assert_eq!(
                dots(&twice, &[&row, &twice]),
                [2.0 * expected, 4.0 * count as f32]
            );
            let last = count.checked_sub(1).map_or(f32::NEG_INFINITY, |i| i as f32);
            assert_eq!(largest(&row), last);
        }
    }
}
