//! Sides of the body and directions of travel.

/// A side of the body, or a direction relative to the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The body's own left.
    Left,
    /// The body's own right.
    Right,
}

impl Side {
    /// Both sides, in the order of pairs of measurements.
    pub const ALL: [Side; 2] = [Side::Left, Side::Right];

    /// Returns the index of the side in pairs of measurements.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the other side.
    pub const fn other(self) -> Side {
        match self {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        }
    }

    /// Returns the name, `left` or `right`.
    pub const fn name(self) -> &'static str {
        match self {
            Side::Left => "left",
            Side::Right => "right",
        }
    }

    /// Returns the sign of headings and distances to this side: 1 for left, -1 for right.
    pub(super) const fn sign(self) -> f32 {
        match self {
            Side::Left => 1.0,
            Side::Right => -1.0,
        }
    }
}

/// A direction of travel, relative to the direction that the body faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Direction {
    Forward,
    Backward,
    Sideways(Side),
}
