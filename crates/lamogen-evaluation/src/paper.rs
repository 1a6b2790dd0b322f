//! The figures of the paper (tables "Quantitative evaluation of controllability" and "Comparison on standard
//! text-to-motion metrics"), measured with MotionDiffuse on HumanML3D's test set.

use lamogen::COMPONENTS;

use super::plan::Method;

/// The paper's table of control for one method.
pub struct PaperControl {
    /// Mean and standard deviation of `(large - small) / small`: `[asked component][measured component]`.
    pub cells: [[(f64, f64); COMPONENTS]; COMPONENTS],
    pub diagonality: f64,
}

/// Returns the paper's table of control, if the paper has the method.
#[expect(clippy::approx_constant, reason = "a measured deviation, not 1/π")]
pub fn control(method: Method) -> Option<PaperControl> {
    let (cells, diagonality) = match method {
        Method::Prompt => (
            [
                [
                    (0.791, 1.360),
                    (0.394, 0.751),
                    (0.272, 0.445),
                    (0.246, 0.460),
                ],
                [
                    (0.235, 1.038),
                    (0.065, 0.480),
                    (0.005, 0.285),
                    (0.017, 0.272),
                ],
                [
                    (0.055, 0.920),
                    (-0.101, 0.364),
                    (-0.117, 0.269),
                    (-0.005, 0.288),
                ],
                [
                    (0.620, 1.221),
                    (0.265, 0.562),
                    (0.175, 0.320),
                    (0.180, 0.414),
                ],
            ],
            0.445,
        ),
        Method::Raw => (
            [
                [
                    (3.084, 1.014),
                    (0.539, 0.318),
                    (-0.003, 0.022),
                    (0.209, 0.228),
                ],
                [
                    (-0.085, 0.237),
                    (0.179, 0.244),
                    (0.018, 0.027),
                    (-0.040, 0.111),
                ],
                [
                    (0.011, 0.215),
                    (0.044, 0.197),
                    (0.476, 0.054),
                    (0.014, 0.093),
                ],
                [
                    (-0.023, 0.115),
                    (-0.018, 0.082),
                    (0.000, 0.019),
                    (1.606, 0.261),
                ],
            ],
            0.973,
        ),
        Method::Classifier => (
            [
                [
                    (0.510, 0.451),
                    (0.232, 0.137),
                    (0.150, 0.058),
                    (0.072, 0.058),
                ],
                [
                    (0.048, 0.039),
                    (0.047, 0.037),
                    (0.044, 0.022),
                    (0.011, 0.009),
                ],
                [
                    (0.040, 0.027),
                    (0.039, 0.024),
                    (0.043, 0.017),
                    (0.009, 0.007),
                ],
                [
                    (0.030, 0.049),
                    (0.016, 0.026),
                    (0.017, 0.016),
                    (0.322, 0.114),
                ],
            ],
            0.802,
        ),
        Method::Laban | Method::Embedding => (
            [
                [
                    (3.081, 2.033),
                    (0.323, 0.369),
                    (0.023, 0.046),
                    (0.163, 0.305),
                ],
                [
                    (0.357, 0.730),
                    (0.418, 0.451),
                    (0.081, 0.101),
                    (0.098, 0.259),
                ],
                [
                    (0.065, 0.716),
                    (0.029, 0.371),
                    (0.379, 0.116),
                    (-0.032, 0.214),
                ],
                [
                    (-0.044, 0.307),
                    (-0.040, 0.153),
                    (-0.012, 0.032),
                    (1.613, 0.470),
                ],
            ],
            0.978,
        ),
        Method::Text | Method::Noise => return None,
    };
    Some(PaperControl { cells, diagonality })
}

/// Returns the paper's R-precision top 1 to 3, FID and diversity, if the paper has the method.
pub fn fidelity(method: Method) -> Option<[f64; 5]> {
    match method {
        Method::Text => Some([0.470, 0.662, 0.767, 2.21, 9.32]),
        Method::Prompt => Some([0.445, 0.630, 0.737, 1.67, 8.72]),
        Method::Raw => Some([0.383, 0.565, 0.689, 1.73, 8.54]),
        Method::Classifier => Some([0.432, 0.629, 0.720, 1.70, 8.59]),
        Method::Laban | Method::Embedding => Some([0.424, 0.613, 0.729, 2.80, 7.92]),
        Method::Noise => None,
    }
}
