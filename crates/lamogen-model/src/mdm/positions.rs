//! The sinusoids of positions and timesteps.

/// Returns the rows `from..to` of the table of positions, row by row: sines of falling frequencies in the even channels, the
/// cosines of the same in the odd ones (Vaswani et al. 2017).
///
/// Intermediate results are rounded to 32 bits, as in the training of the checkpoints.
pub(super) fn position_rows(rows: impl IntoIterator<Item = usize>, width: usize) -> Vec<f32> {
    let frequencies: Vec<f32> = (0..width / 2)
        .map(|wave| {
            let exponent = (2 * wave) as f32 * (-(10000f64.ln()) / width as f64) as f32;
            f64::from(exponent).exp() as f32
        })
        .collect();
    let row = |position: usize| {
        let angles = frequencies
            .iter()
            .map(move |frequency| f64::from(position as f32 * frequency));
        angles.flat_map(|angle| [angle.sin() as f32, angle.cos() as f32])
    };
    rows.into_iter().flat_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_alternate() {
        assert_eq!(position_rows([0], 4), [0.0, 1.0, 0.0, 1.0]);
        let row = position_rows([1], 4);
        assert_eq!(row[..2], [1f32.sin(), 1f32.cos()]);
        assert!((row[2] - 0.01f32.sin()).abs() < 1e-8);
    }
}
