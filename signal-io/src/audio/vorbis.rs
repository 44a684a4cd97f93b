//! The code books of a Vorbis stream, measured before they are unpacked: symphonia takes memory for
//! what their headers claim, and 30 bytes can claim 4 TiB.
//!
//! Source: Vorbis I specification, sections 3.2.1 and 4.2.4.

use crate::error::Fault;

/// The beginning of the packet with the code books.
const SETUP: &[u8] = b"\x05vorbis";
/// Numbers in all code books together. libvorbis needs less than a tenth; 16 MiB do no harm.
const MOST: u64 = 1 << 22;

/// Refuses a setup packet with absurdly large code books. Other packets are fine, and so is one that
/// ends early or is wrong otherwise, which the decoder notices.
pub(super) fn check_setup(packet: &[u8]) -> Result<(), Fault> {
    let Some(content) = packet.strip_prefix(SETUP) else { return Ok(()) };
    let mut bits = Bits { bytes: content, at: 0 };
    let Some(books) = bits.take(8) else { return Ok(()) };
    let mut total = 0;
    for _ in 0..=books {
        let Some(size) = book_size(&mut bits) else { return Ok(()) };
        total += size;
        if total > MOST {
            return Err(Fault::corrupt(format!("its code books have more than {MOST} numbers")));
        }
    }
    Ok(())
}

/// Numbers in the code book that starts here, at least one per entry; passes over it. `None` at the
/// end of the bytes.
fn book_size(bits: &mut Bits) -> Option<u64> {
    bits.take(24)?; // The mark 0x564342.
    let (dimensions, entries) = (bits.take(16)?, bits.take(24)?);
    let size = entries * dimensions.max(1);
    if size > MOST {
        return Some(size); // Refused anyway; its lengths need not be walked through.
    }
    match bits.take(1)? {
        1 => pass_ordered_lengths(bits, entries)?,
        _ => {
            let sparse = bits.take(1)? == 1;
            for _ in 0..entries {
                if !sparse || bits.take(1)? == 1 {
                    bits.take(5)?;
                }
            }
        }
    }
    let lookup = bits.take(4)?;
    if lookup == 1 || lookup == 2 {
        bits.take(64)?; // The smallest number and the step.
        let width = bits.take(4)? + 1;
        bits.take(1)?;
        let values = if lookup == 1 { root(entries, dimensions) } else { entries * dimensions };
        bits.pass(values * width)?;
    }
    Some(size)
}

/// Runs of entries whose codes have 1, 2, 3, ... bits.
fn pass_ordered_lengths(bits: &mut Bits, entries: u64) -> Option<()> {
    bits.take(5)?;
    let mut entry = 0;
    while entry < entries {
        entry += bits.take(u64::BITS - (entries - entry).leading_zeros())?;
    }
    Some(())
}

/// The largest number whose power with exponent `dimensions` is not above `entries`.
fn root(entries: u64, dimensions: u64) -> u64 {
    let power = |n: u64| n.checked_pow(dimensions as u32).filter(|power| *power <= entries);
    // Not more than 2^11 steps: `entries` has 24 bits, and one dimension is its own root.
    match dimensions {
        0 => 0,
        1 => entries,
        _ => (1..).take_while(|n| power(*n).is_some()).last().unwrap_or(0),
    }
}

/// Bits of bytes, lowest first.
struct Bits<'a> {
    bytes: &'a [u8],
    at: u64,
}

impl Bits<'_> {
    /// The next `count` bits, up to 64, as a number.
    fn take(&mut self, count: u32) -> Option<u64> {
        let start = self.at;
        self.pass(u64::from(count))?;
        let bit = |k: u64| u64::from(self.bytes[(k / 8) as usize] >> (k % 8) & 1);
        Some((0..u64::from(count)).fold(0, |number, k| number | bit(start + k) << k))
    }

    /// Goes on by so many bits, if there are so many.
    fn pass(&mut self, count: u64) -> Option<()> {
        let end = self.at.checked_add(count).filter(|end| *end <= 8 * self.bytes.len() as u64)?;
        self.at = end;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes numbers of so many bits, lowest first.
    fn pack(numbers: &[(u64, u32)]) -> Vec<u8> {
        let bits = numbers.iter().flat_map(|(n, count)| (0..*count).map(move |k| n >> k & 1));
        let bits: Vec<u64> = bits.collect();
        let byte = |bits: &[u64]| bits.iter().rev().fold(0, |byte, bit| byte << 1 | *bit as u8);
        [SETUP.to_vec(), bits.chunks(8).map(byte).collect()].concat()
    }

    /// A book of two dimensions and four entries with lengths 2, 2, 2, 2, and its table.
    const SMALL: [(u64, u32); 12] = [
        (0x564342, 24),
        (2, 16),
        (4, 24),
        (1, 1),
        (1, 5),
        (4, 3),
        (1, 4),
        (0, 64),
        (7, 4),
        (0, 1),
        (0xab, 8),
        (0xcd, 8),
    ];

    #[test]
    fn absurd_books_are_refused() {
        let lying = [(0x564342, 24), (65_535, 16), (16_777_215, 24), (1, 1), (23, 5)];
        assert!(check_setup(&pack(&[&[(0, 8)], &lying[..]].concat())).is_err());
        // Behind a small one; many that are large together.
        assert!(check_setup(&pack(&[&[(1, 8)], &SMALL[..], &lying].concat())).is_err());
        let large =
            [(0x564342, 24), (1, 16), (1 << 21, 24), (1, 1), (20, 5), (1 << 21, 22), (0, 4)];
        let many = |n: u64| [vec![(n - 1, 8)], large.repeat(n as usize)].concat();
        assert!(check_setup(&pack(&many(2))).is_ok());
        assert!(check_setup(&pack(&many(3))).is_err());
    }

    #[test]
    fn others_pass() {
        let small = pack(&[&[(0, 8)], &SMALL[..]].concat());
        for end in 0..small.len() {
            assert!(check_setup(&small[..end]).is_ok(), "{end} bytes");
        }
        let mut bits = Bits { bytes: &small[SETUP.len() + 1..], at: 0 };
        assert_eq!(book_size(&mut bits), Some(8));
        let length: u32 = SMALL.iter().map(|(_, count)| count).sum();
        assert_eq!(bits.at, u64::from(length));
        assert!(check_setup(b"\x03vorbis").is_ok() && check_setup(b"").is_ok());
    }

    #[test]
    fn roots() {
        for (entries, dimensions, truth) in [
            (81, 4, 3),
            (80, 4, 2),
            (1, 7, 1),
            (0, 3, 0),
            (5, 1, 5),
            (16_777_215, 2, 4095),
            (9, 0, 0),
        ] {
            assert_eq!(root(entries, dimensions), truth, "{entries}, {dimensions}");
        }
    }
}
