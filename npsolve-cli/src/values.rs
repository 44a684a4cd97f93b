//! Values of options: parsed and checked before anything is read.

mod place;

use std::fmt;
use std::time::Duration;

use inr_core::Interpolation;
use poisson_loss::{Guidance, Strongest};

pub use place::{Coordinate, Counts, MeshCounts, MeshFile, Place, Shape, place, shape};

/// A [`Guidance`] by its name, for any number of channels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GuidanceName {
    /// `patch`
    Patch,
    /// `strongest`, `strongest:channel`, `strongest:component`
    Strongest(Strongest),
    /// `mix:MU,PHI`, and `sum` for `mix:1,1`
    Mix {
        /// Factor of the background's gradient.
        mu: f32,
        /// Factor of the patch's gradient.
        phi: f32,
    },
    /// `monochrome`
    Monochrome,
}

/// What `--guidance` takes.
pub const KNOWN_GUIDANCE: &str =
    "patch, strongest, strongest:channel, strongest:component, sum, mix:MU,PHI, monochrome";

impl GuidanceName {
    /// The guidance for `C` channels.
    pub fn to_guidance<const D: usize, const C: usize>(self) -> Guidance<D, C> {
        match self {
            Self::Patch => Guidance::Patch,
            Self::Strongest(rule) => Guidance::Strongest(rule),
            Self::Mix { mu, phi } => Guidance::Mix { mu, phi },
            Self::Monochrome => Guidance::Monochrome,
        }
    }

    /// Whether a channel's guidance depends on that channel alone.
    pub fn is_per_channel(self) -> bool {
        !matches!(self, Self::Strongest(Strongest::Joint) | Self::Monochrome)
    }

    /// The names that manifests of scenes use, besides those of the command line.
    pub fn from_manifest(name: &str) -> Result<Self, String> {
        match name {
            "import" => Ok(Self::Patch),
            "mixed_max" => Ok(Self::Strongest(Strongest::Joint)),
            other => guidance(other),
        }
    }
}

impl fmt::Display for GuidanceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.to_guidance::<1, 1>())
    }
}

/// Parses `--guidance`.
pub fn guidance(text: &str) -> Result<GuidanceName, String> {
    Ok(match text {
        "patch" => GuidanceName::Patch,
        "strongest" => GuidanceName::Strongest(Strongest::Joint),
        "strongest:channel" => GuidanceName::Strongest(Strongest::PerChannel),
        "strongest:component" => GuidanceName::Strongest(Strongest::PerComponent),
        "sum" => GuidanceName::Mix { mu: 1.0, phi: 1.0 },
        "monochrome" => GuidanceName::Monochrome,
        other => {
            let factors = other
                .strip_prefix("mix:")
                .ok_or_else(|| format!("unknown guidance; known are {KNOWN_GUIDANCE}"))?;
            let [mu, phi] = pair(factors)
                .ok_or("mix takes two numbers: mix:MU,PHI with the background's factor first")?;
            GuidanceName::Mix { mu, phi }
        }
    })
}

/// Parses a number above zero.
pub fn positive(text: &str) -> Result<f32, String> {
    number(text).filter(|v| *v > 0.0).ok_or_else(|| "must be a number above 0".to_owned())
}

/// Parses a number that is not below zero.
pub fn not_negative(text: &str) -> Result<f32, String> {
    number(text).filter(|v| *v >= 0.0).ok_or_else(|| "must be 0 or a number above".to_owned())
}

/// Parses a relative tolerance.
pub fn tolerance(text: &str) -> Result<f32, String> {
    number(text)
        .filter(|v| *v > 0.0 && *v < 1.0)
        .ok_or_else(|| "must be a number between 0 and 1, for example 1e-6".to_owned())
}

/// Width and height in pixels, each at least 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size(pub [usize; 2]);

/// A rectangle in pixels: its left and upper edge, its width and height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crop {
    /// Left and upper edge, at least 0.
    pub start: [f32; 2],
    /// Width and height, above 0.
    pub size: [f32; 2],
}

/// One slice of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slice {
    /// The axis across it: 0 for x.
    pub axis: usize,
    /// Its number.
    pub index: usize,
}

/// Parses `--slice`.
pub fn slice(text: &str) -> Result<Slice, String> {
    let parsed = || {
        let (axis, index) = text.split_once(':')?;
        let axis = ["x", "y", "z"].iter().position(|a| *a == axis)?;
        Some(Slice { axis, index: index.parse().ok()? })
    };
    parsed().ok_or_else(|| "write the axis and the number of the slice: z:40".to_owned())
}

/// Parses `--view`.
pub fn view(text: &str) -> Result<[f32; 2], String> {
    pair(text).ok_or_else(|| "write column and row with a comma: 1.5,2".to_owned())
}

/// Parses any number.
pub fn any_number(text: &str) -> Result<f32, String> {
    number(text).ok_or_else(|| "must be a number".to_owned())
}

/// Parses `--size`.
pub fn size(text: &str) -> Result<Size, String> {
    let parsed = || {
        let (w, h) = text.split_once(['x', 'X'])?;
        let (w, h) = (w.trim().parse().ok()?, h.trim().parse().ok()?);
        (w > 0 && h > 0).then_some(Size([w, h]))
    };
    parsed().ok_or_else(|| "write width and height with an x between: 1280x960".to_owned())
}

/// Parses `--crop`.
pub fn crop(text: &str) -> Result<Crop, String> {
    let numbers: Vec<f32> = text.split(',').filter_map(number).collect();
    match numbers[..] {
        [x, y, w, h] if text.matches(',').count() == 3 && x.min(y) >= 0.0 && w.min(h) > 0.0 => {
            Ok(Crop { start: [x, y], size: [w, h] })
        }
        _ => Err("write four numbers with commas: X,Y,W,H; none below 0, W and H above".to_owned()),
    }
}

/// Parses a time: a number of seconds, or one with the unit ms, s or m.
pub fn duration(text: &str) -> Result<Duration, String> {
    let units = [("ms", 1e-3), ("s", 1.0), ("m", 60.0), ("", 1.0)];
    let parsed = units.iter().find_map(|(unit, seconds)| {
        let count: f64 = text.trim().strip_suffix(unit)?.trim().parse().ok()?;
        Duration::try_from_secs_f64(count * seconds).ok().filter(|d| !d.is_zero())
    });
    parsed.ok_or_else(|| "write a time above 0: 2s, 500ms, 2m; a number is seconds".to_owned())
}

/// Parses an amount of memory: a number of bytes, or one with a unit. K, M and G are powers of 1024, as are KiB, MiB and
/// GiB; KB, MB and GB are powers of 1000.
pub fn bytes(text: &str) -> Result<u64, String> {
    let units = [("KiB", 10), ("MiB", 20), ("GiB", 30), ("K", 10), ("M", 20), ("G", 30)]
        .map(|(unit, bits)| (unit, f64::from(1u32 << bits)));
    let others = [("KB", 1e3), ("MB", 1e6), ("GB", 1e9), ("B", 1.0), ("", 1.0)];
    let parsed = units.iter().chain(&others).find_map(|(unit, factor)| {
        let at = text.len().checked_sub(unit.len())?;
        let (count, end) = text.split_at_checked(at)?;
        let count: f64 =
            if end.eq_ignore_ascii_case(unit) { count.trim().parse().ok()? } else { None? };
        let bytes = count * factor;
        (bytes >= 1.0 && bytes < 2f64.powi(60)).then_some(bytes as u64)
    });
    parsed
        .ok_or_else(|| "write an amount of memory: 4G, 500M, 1.5GiB; a number is bytes".to_owned())
}

/// Parses a level in dB.
pub fn decibel(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok().filter(|v: &f64| *v > 0.0 && v.is_finite());
    value.ok_or_else(|| "must be a number of dB above 0, for example 35".to_owned())
}

/// Parses a count.
pub fn at_least_one(text: &str) -> Result<usize, String> {
    let value = text.trim().parse().ok().filter(|n| (1..=MOST).contains(n));
    value.ok_or_else(|| format!("must be a whole number from 1 to {MOST}"))
}

/// Parses the size of a table.
pub fn power_of_two(text: &str) -> Result<usize, String> {
    let value = text.trim().parse().ok().filter(|n: &usize| n.is_power_of_two() && *n <= MOST);
    value.ok_or_else(|| format!("must be a power of two up to {MOST}, for example 32768"))
}

/// Far beyond use, and no size computed from it overflows.
const MOST: usize = 1 << 24;

/// Parses `--interpolation`.
pub fn interpolation(text: &str) -> Result<Interpolation, String> {
    match text {
        "nearest" => Ok(Interpolation::Nearest),
        "linear" => Ok(Interpolation::Linear),
        "smoothstep" => Ok(Interpolation::Smoothstep),
        "cubic" => Ok(Interpolation::Cubic),
        _ => Err("known are nearest, linear, smoothstep, cubic".to_owned()),
    }
}

fn number(text: &str) -> Option<f32> {
    text.trim().parse().ok().filter(|v: &f32| v.is_finite())
}

fn pair(text: &str) -> Option<[f32; 2]> {
    let (x, y) = text.split_once(',')?;
    Some([number(x)?, number(y)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_of_memory_have_units() {
        for (text, expected) in [
            ("4G", 4 << 30),
            ("1.5GiB", 3 << 29),
            ("500m", 500 << 20),
            ("64 MB", 64_000_000),
            ("3kb", 3000),
            ("4096", 4096),
            ("7B", 7),
        ] {
            assert_eq!(bytes(text), Ok(expected), "{text}");
        }
        for text in ["", "G", "-1G", "0", "nan", "inf", "4T", "4 Gi", "1e30G", "\u{20ac}G"] {
            assert!(bytes(text).is_err(), "{text}");
        }
    }

    #[test]
    fn guidance_names_round_trip() {
        for name in KNOWN_GUIDANCE.replace("mix:MU,PHI", "mix:0.5,-2").split(", ") {
            assert_eq!(guidance(name).unwrap().to_string(), name);
        }
        assert_eq!(GuidanceName::from_manifest("import"), Ok(GuidanceName::Patch));
        assert_eq!(GuidanceName::from_manifest("sum").unwrap().to_string(), "sum");
    }

    #[test]
    fn bad_values_are_refused_with_the_rule() {
        assert!(guidance("soft").unwrap_err().contains("strongest:component"));
        assert!(guidance("mix:1").unwrap_err().contains("MU,PHI"));
        assert!(guidance("mix:nan,1").is_err());
        for text in ["0", "-1", "inf", "NaN", "", "three"] {
            assert!(positive(text).is_err(), "{text}");
        }
        assert_eq!(not_negative("0"), Ok(0.0));
        assert!(not_negative("-0.1").is_err());
        assert!(tolerance("1").is_err() && tolerance("1e-3").is_ok());
    }

    #[test]
    fn times_sizes_and_crops() {
        let milliseconds = |text| duration(text).map(|d| d.as_millis());
        for (text, expected) in
            [("2s", 2000), ("500ms", 500), ("2m", 120_000), ("10", 10_000), ("0.5 s", 500)]
        {
            assert_eq!(milliseconds(text), Ok(expected), "{text}");
        }
        for text in ["", "s", "-1s", "0", "1h", "nan", "inf", "1e300"] {
            assert!(duration(text).is_err(), "{text}");
        }
        assert_eq!(size("640x480"), Ok(Size([640, 480])));
        for text in ["640", "0x4", "4x0", "x", "4x-4", "4.5x4", "1x2x3"] {
            assert!(size(text).is_err(), "{text}");
        }
        assert_eq!(crop("0.5,1,3,2.25"), Ok(Crop { start: [0.5, 1.0], size: [3.0, 2.25] }));
        for text in ["1,2,3", "1,2,3,4,5", "1,2,0,4", "-1,2,3,4", "1,,3,4", "1,2,nan,4"] {
            assert!(crop(text).is_err(), "{text}");
        }
        assert_eq!(slice("y:7"), Ok(Slice { axis: 1, index: 7 }));
        for text in ["7", "t:7", "x:-1", "x:"] {
            assert!(slice(text).is_err(), "{text}");
        }
        assert_eq!(view("0.5,2"), Ok([0.5, 2.0]));
        assert!(power_of_two("32768").is_ok() && power_of_two("1000").is_err());
        assert!(at_least_one("0").is_err() && at_least_one("20000000").is_err());
        assert!(decibel("-3").is_err() && decibel("35.5").is_ok());
    }
}
