/// Whether a JPEG stream reaches its end-of-image marker.
///
/// The decoder fills the missing part of a file that was cut short with grey and reports success;
/// this walk over the markers is what tells such a file from a whole one. Bytes after the end
/// marker are ignored: cameras append previews there.
pub(super) fn is_complete(bytes: &[u8]) -> bool {
    let mut at = 2; // After the start-of-image marker.
    while let Some(marker) = next_marker(bytes, &mut at) {
        match marker {
            0xd9 => return true,
            // Markers without a segment: TEM and restarts.
            0x01 | 0xd0..=0xd8 => {}
            _ => {
                let Some(&[high, low]) = bytes.get(at..at + 2) else { return false };
                at += usize::from(u16::from_be_bytes([high, low]));
            }
        }
    }
    false
}

/// The next marker at or after `at`, which moves behind it. Entropy-coded data is skipped on the
/// way: in it, 0xff is followed by 0.
fn next_marker(bytes: &[u8], at: &mut usize) -> Option<u8> {
    loop {
        *at += bytes.get(*at..)?.iter().position(|b| *b == 0xff)?;
        *at += bytes.get(*at..)?.iter().position(|b| *b != 0xff)?;
        *at += 1;
        match bytes[*at - 1] {
            0 => {}
            marker => return Some(marker),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_marker_decides() {
        // Start, a comment holding a false end marker, a scan with stuffed bytes and a restart, end.
        let whole = [
            0xff, 0xd8, 0xff, 0xfe, 0, 4, 0xff, 0xd9, 0xff, 0xda, 0, 2, 1, 0xff, 0, 2, 0xff, 0xd0,
            3, 0xff, 0xff, 0xd9, 7, 7,
        ];
        assert!(is_complete(&whole));
        for end in 0..whole.len() - 2 {
            assert!(!is_complete(&whole[..end]), "cut at {end}");
        }
    }
}
