//! The block structure of GIF files, without their pictures.
//!
//! Source: GIF89a specification, sections 12 to 27.

use crate::budget::check_plausible;
use crate::error::Fault;

/// The bytes that have not been looked at.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let (head, rest) = self.0.split_at_checked(count).ok_or_else(Fault::cut_short)?;
        self.0 = rest;
        Ok(head)
    }

    fn byte(&mut self) -> Result<u8, Fault> {
        Ok(self.take(1)?[0])
    }

    /// Skips the table of colours that packed flags announce.
    fn colors(&mut self, flags: u8) -> Result<(), Fault> {
        if flags & 0x80 != 0 {
            self.take(3 << ((flags & 7) + 1))?;
        }
        Ok(())
    }

    /// Skips data up to the empty sub-block; answers its length.
    fn sub_blocks(&mut self) -> Result<usize, Fault> {
        let mut sum = 0;
        loop {
            match self.byte()? {
                0 => return Ok(sum),
                n => sum += self.take(n.into())?.len(),
            }
        }
    }
}

/// Walks over all blocks up to the trailer and answers the number of frames, at least 1.
///
/// The decoder stops silently where a file ends between two frames, and takes memory for a frame of
/// any size before it reads its data; neither is left to find out for it.
pub(super) fn check(bytes: &[u8]) -> Result<usize, Fault> {
    let mut rest = Rest(bytes);
    if !rest.take(6)?.starts_with(b"GIF8") {
        return Err(Fault::corrupt("it does not start with its signature"));
    }
    let screen = rest.take(7)?;
    rest.colors(screen[4])?;
    let mut frames = 0;
    loop {
        match rest.byte()? {
            0x3b if frames == 0 => return Err(Fault::Empty),
            0x3b => return Ok(frames),
            0x21 => {
                rest.byte()?; // Which extension: all have the same structure.
                rest.sub_blocks()?;
            }
            0x2c => {
                let head = rest.take(9)?;
                let side = |at: usize| u64::from(u16::from_le_bytes([head[at], head[at + 1]]));
                let (width, height) = (side(4), side(6));
                if width == 0 || height == 0 {
                    return Err(Fault::corrupt(format!("frame {frames} has no pixels")));
                }
                rest.colors(head[8])?;
                rest.byte()?; // Bits of the first codes.
                // At most 4096 pixels of 4 decoded bytes for a code of 9 bits or more.
                check_plausible(width * height * 4, rest.sub_blocks()?, 4096 * 4)?;
                frames += 1;
            }
            other => return Err(Fault::corrupt(format!("unknown block 0x{other:02x}"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_counted() {
        let head = b"GIF89a\x01\0\x01\0\x80\0\0\0\0\0\xff\xff\xff";
        let frame = b"\x21\xf9\x04\0\0\0\0\0\x2c\0\0\0\0\x01\0\x01\0\0\x02\x02\x44\x01\0";
        let whole = [&head[..], frame, frame, b"\x3b"].concat();
        assert_eq!(check(&whole).unwrap(), 2);
        for end in 0..whole.len() {
            assert!(matches!(check(&whole[..end]), Err(Fault::Corrupt(_))), "cut at {end}");
        }
        assert!(matches!(check(&[&head[..], b"\x3b"].concat()), Err(Fault::Empty)));
    }
}
