use std::fmt;
use std::sync::Arc;

use inr_core::Jet;

/// How `strongest` compares two gradients.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Strongest {
    /// One decision per point: the larger sum of squares over all channels and axes. No hue shifts.
    #[default]
    Joint,
    /// One decision per point and channel: the larger norm over the axes.
    PerChannel,
    /// One decision per point, channel and axis: the larger magnitude (the paper's release).
    PerComponent,
}

/// A user's guidance: position, background jet, patch jet; returns the gradient to follow.
///
/// Gradients are in change per reference pitch: `h_ref * dc/dx_d`.
pub type CustomGuidance<const D: usize, const C: usize> =
    Arc<dyn Fn(&[f32; D], &Jet<D, C>, &Jet<D, C>) -> [[f32; D]; C] + Send + Sync>;

/// The vector field `v` that the gradient of the blend follows inside the region.
///
/// Source: Perez, Gangnet and Blake 2003 (import, mixing, monochrome transfer); Wu et al. 2024,
/// section 3.3 (`sum` is its overlay, `mix` with 1/2 and 1/2 its smoothing).
#[derive(Clone, Default)]
pub enum Guidance<const D: usize, const C: usize> {
    /// The gradient of the patch.
    #[default]
    Patch,
    /// The larger of both gradients.
    Strongest(Strongest),
    /// `mu` times the background's gradient plus `phi` times the patch's.
    Mix {
        /// Factor of the background's gradient.
        mu: f32,
        /// Factor of the patch's gradient.
        phi: f32,
    },
    /// The gradient of the patch's luminance (Rec. 709 for three channels, else the mean) on
    /// every channel.
    Monochrome,
    /// Any function of position and both jets.
    Custom(CustomGuidance<D, C>),
}

impl<const D: usize, const C: usize> Guidance<D, C> {
    /// The sum of both gradients: the paper's overlay.
    pub const SUM: Self = Self::Mix { mu: 1.0, phi: 1.0 };

    /// The guidance at one point.
    #[inline(always)]
    pub fn evaluate(
        &self,
        x: &[f32; D],
        background: &Jet<D, C>,
        patch: &Jet<D, C>,
    ) -> [[f32; D]; C] {
        let (s, t) = (&background.grad, &patch.grad);
        match self {
            Self::Patch => *t,
            Self::Strongest(Strongest::Joint) => {
                let norm = |g: &[[f32; D]; C]| g.iter().flatten().map(|v| v * v).sum::<f32>();
                if norm(t) >= norm(s) { *t } else { *s }
            }
            Self::Strongest(Strongest::PerChannel) => std::array::from_fn(|c| {
                let norm = |g: &[f32; D]| g.iter().map(|v| v * v).sum::<f32>();
                if norm(&t[c]) >= norm(&s[c]) { t[c] } else { s[c] }
            }),
            Self::Strongest(Strongest::PerComponent) => std::array::from_fn(|c| {
                std::array::from_fn(
                    |d| if t[c][d].abs() >= s[c][d].abs() { t[c][d] } else { s[c][d] },
                )
            }),
            Self::Mix { mu, phi } => {
                std::array::from_fn(|c| std::array::from_fn(|d| mu * s[c][d] + phi * t[c][d]))
            }
            Self::Monochrome => {
                let weight = luminance_weights::<C>();
                let gray = std::array::from_fn(|d| (0..C).map(|c| weight[c] * t[c][d]).sum());
                [gray; C]
            }
            Self::Custom(f) => f(x, background, patch),
        }
    }

    /// Whether `v` is the patch's gradient: then nothing is to be done where the region is deep.
    pub(crate) fn is_patch(&self) -> bool {
        matches!(self, Self::Patch)
    }

    /// Whether the rule looks at values as well.
    pub(crate) fn needs_values(&self) -> bool {
        matches!(self, Self::Custom(_))
    }
}

/// Rec. 709 for three channels, equal weights otherwise.
fn luminance_weights<const C: usize>() -> [f32; C] {
    const REC_709: [f32; 3] = [0.2126, 0.7152, 0.0722];
    std::array::from_fn(|c| if C == 3 { REC_709[c] } else { 1.0 / C as f32 })
}

impl<const D: usize, const C: usize> fmt::Debug for Guidance<D, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Patch => write!(f, "patch"),
            Self::Strongest(Strongest::Joint) => write!(f, "strongest"),
            Self::Strongest(Strongest::PerChannel) => write!(f, "strongest:channel"),
            Self::Strongest(Strongest::PerComponent) => write!(f, "strongest:component"),
            Self::Mix { mu, phi } if *mu == 1.0 && *phi == 1.0 => write!(f, "sum"),
            Self::Mix { mu, phi } => write!(f, "mix:{mu},{phi}"),
            Self::Monochrome => write!(f, "monochrome"),
            Self::Custom(_) => write!(f, "custom"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jets() -> (Jet<2, 2>, Jet<2, 2>) {
        let s = Jet { value: [0.0; 2], grad: [[3.0, 0.0], [0.5, -0.1]] };
        let t = Jet { value: [0.0; 2], grad: [[1.0, 2.0], [-2.0, 0.2]] };
        (s, t)
    }

    fn of(guidance: Guidance<2, 2>) -> [[f32; 2]; 2] {
        let (s, t) = jets();
        guidance.evaluate(&[0.0; 2], &s, &t)
    }

    #[test]
    fn rules_follow_their_definitions() {
        let (s, t) = jets();
        assert_eq!(of(Guidance::Patch), t.grad);
        // 9.26 against 9.04: the background wins jointly.
        assert_eq!(of(Guidance::Strongest(Strongest::Joint)), s.grad);
        assert_eq!(of(Guidance::Strongest(Strongest::PerChannel)), [s.grad[0], t.grad[1]]);
        assert_eq!(of(Guidance::Strongest(Strongest::PerComponent)), [[3.0, 2.0], [-2.0, 0.2]]);
        assert_eq!(of(Guidance::SUM), [[4.0, 2.0], [-1.5, 0.1]]);
        assert_eq!(of(Guidance::Mix { mu: 0.5, phi: 0.5 }), [[2.0, 1.0], [-0.75, 0.05]]);
        assert_eq!(of(Guidance::Monochrome), [[-0.5, 1.1]; 2]);
        assert_eq!(of(Guidance::Custom(Arc::new(|_, s, _| s.grad))), s.grad);
    }
}
