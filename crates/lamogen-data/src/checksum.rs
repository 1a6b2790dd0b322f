//! A 64-bit checksum of bytes.

/// A 64-bit FNV-1a checksum. It is the same on every machine and in every version, and is not cryptographic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checksum(u64);

impl Checksum {
    /// Returns the checksum of no bytes. Different seeds give different sums of the same bytes; seed 0 is plain FNV-1a.
    pub fn new(seed: u64) -> Self {
        Checksum(0xcbf2_9ce4_8422_2325 ^ seed)
    }

    /// Adds bytes to the checksum.
    pub fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// Returns the checksum of all bytes that were added.
    pub fn value(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_fnv_1a() {
        let checksum = |text: &str| {
            let mut sum = Checksum::new(0);
            sum.add(text.as_bytes());
            sum.value()
        };
        assert_eq!(checksum(""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(checksum("a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(checksum("foobar"), 0x8594_4171_f739_67e8);
    }
}
