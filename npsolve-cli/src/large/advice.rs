//! How much memory there is, how much is taken, and when to blend in blocks.

use signal_io::{PictureInfo, ReadOptions, RowReader};

use crate::args::BlendArgs;
use crate::console;
use crate::kind::SignalKind;

/// Bytes per value of both pictures, and per value of the region, that a blend in memory takes at the very least: a
/// measured blend takes about twice as many.
const PER_VALUE: u64 = 8;
const PER_VALUE_SOLVED: u64 = 24;

/// Warns where a blend of these pictures in memory needs clearly more than there is. Looks at the heads of files that
/// are read by rows only.
pub fn warn_if_larger_than_memory(args: &BlendArgs) {
    let Some(available) = field("/proc/meminfo", "MemAvailable:") else { return };
    let head_alone = ReadOptions { limit_bytes: 0, ..ReadOptions::default() };
    let values = |path| {
        let info = RowReader::open(path, &head_alone).ok()?.info().clone();
        Some(count(&info))
    };
    let (Some(background), Some(patch)) = (values(&args.background), values(&args.patch)) else {
        return;
    };
    let solved = if args.scene.mask.is_some() || args.scene.region.is_some() { 0 } else { patch };
    let needed = PER_VALUE * (background + patch) + PER_VALUE_SOLVED * solved.min(background);
    if needed > available {
        let half = (available / 2) >> 20;
        console::warn(&[format!(
            "this {} takes {} of memory at the very least, and {} are free; --max-memory {half}M does it in blocks",
            SignalKind::Image.name(),
            human(needed),
            human(available)
        )]);
    }
}

fn count(info: &PictureInfo) -> u64 {
    (info.width as u64)
        .saturating_mul(info.height as u64)
        .saturating_mul(info.channels.len() as u64)
}

/// The most memory that this process held so far, where the system says so.
pub fn peak_memory() -> Option<u64> {
    field("/proc/self/status", "VmHWM:")
}

/// A number of kilobytes in a file of the system, in bytes.
fn field(path: &str, name: &str) -> Option<u64> {
    let text = std::fs::read_to_string(path).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| 1024 * kilobytes)
}

/// "3.9 GiB"
pub fn human(bytes: u64) -> String {
    let units = ["bytes", "KiB", "MiB", "GiB", "TiB"];
    let power = (0..4).rev().find(|k| bytes >> (10 * (k + 1)) > 0).map_or(0, |k| k + 1);
    match power {
        0 => format!("{bytes} bytes"),
        _ => format!("{:.1} {}", bytes as f64 / (1u64 << (10 * power)) as f64, units[power]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_readable() {
        assert_eq!(human(1023), "1023 bytes");
        assert_eq!(human(1536), "1.5 KiB");
        assert_eq!(human(4 << 30), "4.0 GiB");
        assert_eq!(human(5 << 50), "5120.0 TiB");
        assert_eq!(field("/no/such/file", "VmHWM:"), None);
    }
}
