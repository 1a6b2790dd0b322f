//! A number that stands for some bytes.

/// FNV-1a in 64 bits: the same on every machine and for ever. Not for secrets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checksum(u64);

impl Checksum {
    /// Of no bytes yet. Another seed gives another sum of the same bytes; 0 is FNV-1a itself.
    pub fn new(seed: u64) -> Self {
        Checksum(0xcbf2_9ce4_8422_2325 ^ seed)
    }

    /// Adds bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// The number.
    pub fn value(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_fnv_1a() {
        let of = |text: &str| {
            let mut sum = Checksum::new(0);
            sum.add(text.as_bytes());
            sum.value()
        };
        assert_eq!(of(""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(of("a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(of("foobar"), 0x8594_4171_f739_67e8);
    }
}
