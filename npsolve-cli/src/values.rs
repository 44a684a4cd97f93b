//! Values of options: parsed and checked before anything is read.

use std::fmt;

use poisson_loss::{Guidance, Strongest};

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
    pub fn to_guidance<const C: usize>(self) -> Guidance<2, C> {
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
        write!(f, "{:?}", self.to_guidance::<1>())
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

/// Parses a position `X,Y` in pixels.
pub fn point(text: &str) -> Result<[f32; 2], String> {
    pair(text).ok_or_else(|| "write two numbers with a comma and no space: X,Y".to_owned())
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
        assert_eq!(point("-3.5,20"), Ok([-3.5, 20.0]));
        assert!(point("3").is_err() && point("3;4").is_err());
    }
}
